"""Triangulate both points of left/right pairs without trusting the labels."""
