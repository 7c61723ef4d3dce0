"""Detectors: one file per record of :mod:`posefuse.detection.registry`, and functions of the caller."""
