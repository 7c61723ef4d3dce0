"""Velocities on paths: windows, gaps, irregular times, and unknown times."""

import numpy as np
import pytest

from posefuse.biomechanics.path_velocity import Path, VelocityWindow, path_velocity


def path(time_s: np.ndarray, group: np.ndarray | None = None) -> Path:
    """Return a path with x = t**2 and a standard deviation of 10 mm."""
    xyz = np.stack([time_s**2, 2.0 * time_s, np.ones(len(time_s))], axis=1)
    groups = np.zeros(len(time_s), dtype=np.int64) if group is None else group
    return Path(time_s, xyz, np.full(xyz.shape, 0.01), groups)


@pytest.mark.parametrize(("rate_hz", "neighbors"), [(240.0, 14), (60.0, 3), (25.0, 1), (10.0, 1)])
def test_the_window_is_a_duration_with_at_least_three_frames(rate_hz, neighbors):
    time_s = np.arange(40) / rate_hz
    window = VelocityWindow.of(time_s)
    assert window.neighbors == neighbors
    velocity, sd = path_velocity(path(time_s), window, "solved")
    known = np.isfinite(velocity).all(axis=1)
    assert known[1:-1].all()
    np.testing.assert_allclose(velocity[known, 0], 2.0 * time_s[known], atol=1e-9)
    np.testing.assert_allclose(velocity[known, 1], 2.0, atol=1e-9)
    assert (sd[known] > 0).all()


@pytest.mark.parametrize("time_s", [np.full(20, np.nan), np.arange(20) / 5.0, np.zeros(1), np.empty(0)])
def test_unknown_times_and_distant_frames_have_no_velocity(time_s):
    velocity, sd = path_velocity(path(time_s), VelocityWindow.of(time_s), "measured")
    assert velocity.shape == sd.shape == (len(time_s), 3)
    assert np.isnan(velocity).all()
    assert np.isnan(sd).all()


def test_frames_of_another_group_are_not_used():
    time_s = np.arange(30) / 60.0
    group = np.repeat([0, 1, -1], 10)
    moved = path(time_s, group)
    moved = Path(time_s, moved.xyz_m + 5.0 * (group == 1)[:, None], moved.sd_m, group)
    velocity, _ = path_velocity(moved, VelocityWindow.of(time_s), "measured")
    np.testing.assert_allclose(velocity[:20, 0], 2.0 * time_s[:20], atol=1e-8)
    assert np.isnan(velocity[20:]).all()


def test_irregular_times_are_respected():
    time_s = np.sort(np.random.default_rng(0).uniform(0.0, 1.0, 60))
    velocity, _ = path_velocity(path(time_s), VelocityWindow.of(time_s), "measured")
    known = np.isfinite(velocity[:, 0])
    assert known.sum() > 50
    np.testing.assert_allclose(velocity[known, 0], 2.0 * time_s[known], atol=1e-6)


def test_sudden_changes_of_smoothed_paths_are_less_certain():
    time_s = np.arange(60) / 60.0
    bounce = np.abs(time_s - 0.5)
    smoothed = Path(time_s, np.repeat(bounce[:, None], 3, axis=1), np.full((60, 3), 0.001), np.zeros(60, dtype=int))
    _, sd = path_velocity(smoothed, VelocityWindow.of(time_s), "solved")
    assert sd[30, 0] < sd[27, 0]
    assert sd[27, 0] > 3.0 * sd[10, 0]
