"""Poses, joint angles and their standard deviations, and twist."""
