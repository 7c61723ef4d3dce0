"""Refine calibrations by bundle adjustment of points that the cameras observed."""
