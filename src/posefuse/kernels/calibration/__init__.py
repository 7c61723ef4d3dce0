"""Kernels of bundle adjustment."""
