"""Calibration of cameras by the people or animals that they film."""
