"""Calibration of cameras by points of known position."""
