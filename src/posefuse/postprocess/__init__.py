"""Gaps and filters: what can be done with points one after the other in time, each keypoint by itself."""
