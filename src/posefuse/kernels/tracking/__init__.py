"""Kernels of tracking: prediction, data association, update and smoothing of articulated bodies."""
