"""Kernels of kinematics."""
