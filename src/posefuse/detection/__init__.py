"""Detection of 2D points in images."""
