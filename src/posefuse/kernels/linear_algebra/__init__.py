"""Rotations, small symmetric systems and packed triangles."""
