"""Overlay videos: reprojected skeletons on the cameras' videos."""
