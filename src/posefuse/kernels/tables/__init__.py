"""Kernels that write tables as text."""
