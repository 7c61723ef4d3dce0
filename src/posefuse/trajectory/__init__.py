"""Trajectory solve: keypoint paths over a recording that explain all views, move smoothly and keep bone lengths."""
