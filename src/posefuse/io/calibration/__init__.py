"""Calibration formats: one module per format, each with a constant ``FORMAT``."""
