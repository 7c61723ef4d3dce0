"""Kernels of recording diagnostics: epipolar residuals."""
