"""Scenes with known truth: cameras, moving people, detectors with faults."""
