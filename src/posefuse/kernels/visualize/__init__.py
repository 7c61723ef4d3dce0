"""Kernels of drawing: anti-aliased shapes."""
