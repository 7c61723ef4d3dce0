"""Epipolar residuals."""
