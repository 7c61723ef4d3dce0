"""Skeletons, kinematic trees, separately tracked parts and segment masses."""
