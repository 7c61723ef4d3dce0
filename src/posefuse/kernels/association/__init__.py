"""Kernels of multi-view association: log odds of view pairs, groups of detections, and trunk centers."""
