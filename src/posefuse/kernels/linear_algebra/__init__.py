"""Kernels of linear algebra: rotations, symmetric systems and packed triangles."""
