"""Diagnose calibration, synchronization and keypoint faults of a recording."""
