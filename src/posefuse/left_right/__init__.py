"""Correct swapped left/right labels: label-free pair solutions, and the assignment of left and right over time."""
