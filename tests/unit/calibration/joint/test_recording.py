"""Observations at shifted times."""

from dataclasses import replace

import numpy as np
import pytest


def test_zero_offset_returns_the_frames(walk):
    recording = walk[0]
    frames = np.array([3, 10])
    xy, sigma = recording.at(frames, np.zeros((2, recording.n_views)))
    assert np.array_equal(np.moveaxis(xy, 2, 1), recording.xy[frames])
    assert np.array_equal(np.moveaxis(sigma, 2, 1), recording.sigma[frames])


def test_offset_interpolates_earlier_frames(walk):
    """A view whose frames were captured later than stated shows an event at an earlier timestamp."""
    recording = walk[0]
    offset_s = np.zeros((1, recording.n_views))
    offset_s[0, 1] = 0.25 * recording.period_s
    xy, _ = recording.at(np.array([10]), offset_s)
    expected = 0.75 * recording.xy[10, 1] + 0.25 * recording.xy[9, 1]
    assert xy[0, :, 1] == pytest.approx(expected, nan_ok=True)


def test_pieces_and_ends_are_not_interpolated_across(walk):
    recording = replace(walk[0], runs=(np.arange(len(walk[0].xy)) >= 10).astype(int))
    half = np.full((2, recording.n_views), 0.5 * recording.period_s)
    xy, _ = recording.at(np.array([0, 10]), half)
    assert np.isnan(xy).all()
