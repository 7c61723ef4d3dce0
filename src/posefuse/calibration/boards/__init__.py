"""Calibration of cameras by a board."""
