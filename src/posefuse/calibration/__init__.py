"""Cameras refined from what they see: bundle adjustment, cameras located from scratch, and how well both are known."""
