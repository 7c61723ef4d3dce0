"""Kernels of left/right resolution: two-point solves of keypoint pairs and assignment of sides over time."""
