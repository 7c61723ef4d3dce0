"""Lens models, observation rows, rays and multi-view points."""
