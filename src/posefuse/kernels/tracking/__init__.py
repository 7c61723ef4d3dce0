"""Articulated prediction, update, matching and smoothing."""
