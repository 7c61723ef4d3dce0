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


def test_small_offsets_move_the_observations(walk):
    """Minutes determine a clock to less than a fiftieth of a frame; a jump there keeps the estimate from converging."""
    recording = walk[0]
    frames = np.arange(2, len(recording.xy) - 2, 7)
    moved = [recording.at(frames, np.full((len(frames), recording.n_views), s))[0] for s in (-1e-4, 0.0, 1e-4, 2e-4)]
    steps = np.diff(np.stack(moved), axis=0)
    assert np.nanmedian(np.abs(steps)) > 0.0
    assert steps[1] == pytest.approx(steps[2], nan_ok=True)


def test_time_of_a_frame_does_not_need_the_next_one(walk):
    recording = replace(walk[0], xy=walk[0].xy.copy())
    recording.xy[11] = np.nan
    at = np.array([10])
    near, far = (recording.at(at, np.full((1, recording.n_views), s * recording.period_s))[0] for s in (-0.01, -0.1))
    assert np.array_equal(np.moveaxis(near, 2, 1)[0], recording.xy[10])
    assert np.isnan(far).all()
