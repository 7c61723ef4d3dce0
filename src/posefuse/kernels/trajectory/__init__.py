"""Kernels of the trajectory solve: banded factorization, terms of the system, and bone coupling."""
