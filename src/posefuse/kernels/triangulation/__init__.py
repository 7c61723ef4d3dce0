"""Kernels of triangulation: two-view hypotheses and the consensus method."""
