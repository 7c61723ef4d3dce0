"""Tests of runs from videos."""
