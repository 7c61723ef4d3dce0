"""Triangulate keypoints from several views; one module per method, and a table of them."""
