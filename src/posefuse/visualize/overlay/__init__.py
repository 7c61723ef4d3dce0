"""Reprojected skeletons on the cameras' videos."""
