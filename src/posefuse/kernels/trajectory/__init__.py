"""Banded solve of trajectories."""
