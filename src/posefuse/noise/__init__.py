"""Estimation of the detector's error model: scale per camera, confidence exponent and tails."""
