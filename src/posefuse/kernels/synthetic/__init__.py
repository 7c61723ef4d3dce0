"""Kernels of simulation: forward kinematics and occlusion."""
