"""Held-out frames and selected points."""

import numpy as np

from posefuse.calibration.point_observations import PointObservations
from posefuse.calibration.selection import held_out_frames, select_spread_points


def test_held_out_frames_and_selected_points_are_spread():
    kept = held_out_frames(1000)
    assert 0.15 < kept.mean() < 0.25
    assert np.abs(np.diff(kept.astype(int))).sum() <= 10
    n = 3000
    points = np.concatenate([np.random.default_rng(0).normal(0, 0.01, (n - 150, 3)), np.ones((150, 3))])
    view, point = np.tile([0, 1], n), np.repeat(np.arange(n), 2)
    observed = PointObservations(
        view, point, np.zeros((2 * n, 2)), np.ones(2 * n), points, np.arange(n), np.zeros(n, dtype=np.int64)
    )
    chosen = select_spread_points(observed, 2, 600)
    assert 300 < chosen.sum() <= 600
    assert chosen[-150:].sum() >= 60
