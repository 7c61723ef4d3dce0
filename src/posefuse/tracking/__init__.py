"""Tracking of several people: articulated states predicted, updated and managed frame by frame."""
