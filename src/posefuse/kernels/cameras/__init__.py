"""Kernels of camera geometry: lens models, observation rows, rays and multi-view points."""
