"""Influences under a working correlation agree with generalized least squares by dense matrices."""

import numpy as np
import pytest

from posefuse.calibration.joint import slow_errors
from posefuse.calibration.joint.equations import Rows, influences, linearize
from posefuse.calibration.joint.estimate import estimate, sample_frames
from posefuse.calibration.joint.noise_law import FAST_S, SLOW_S, NoiseLaw
from posefuse.calibration.joint.slow_errors import correlated_influences, working_law


def rows_of(recording, n: int) -> Rows:
    joint = estimate(recording)
    assert joint is not None
    frames = sample_frames(recording, 300)[:n]
    return linearize(recording, frames, joint.parameters, joint.noise_scale)


def dense(rows: Rows, column: int, law: NoiseLaw) -> np.ndarray:
    """Return the influences of the errors of one keypoint, shape (sample, error, parameter)."""
    n, n_columns = rows.points_m.shape[:2]
    n_views, each = rows.n_views, rows.n_parameters
    at = slice(column, None, n_columns)
    x, points = np.zeros((n, 2 * n_views, n_views * each)), np.zeros((n, 2 * n_views, n, 3))
    for t in range(n):
        points[t, :, t] = rows.by_point[at][t].reshape(-1, 3)
        for v in range(n_views):
            x[t, 2 * v : 2 * v + 2, v * each : (v + 1) * each] = rows.by_view[at][t, v]
    seen = np.repeat(rows.seen[at], 2, axis=-1)
    period = np.floor((rows.time_s - rows.time_s[0]) / slow_errors._PERIOD_S)
    similar = np.exp(-np.median(np.diff(rows.time_s)) / FAST_S)
    variance = law.slow / ((1.0 - law.slow) * (1.0 + similar) / (1.0 - similar))
    apart = np.abs(period[:, None] - period) * slow_errors._PERIOD_S
    slow = variance * np.exp(-apart / SLOW_S)[:, None, :, None] * np.eye(2 * n_views)[None, :, None]
    size = n * 2 * n_views
    kept = seen.ravel()
    weight = np.linalg.inv((np.eye(size) + slow.reshape(size, size))[np.ix_(kept, kept)])
    x, points = x.reshape(size, -1)[kept], points.reshape(size, -1)[kept]
    points = points[:, points.any(axis=0)]
    left = weight - weight @ points @ np.linalg.solve(points.T @ weight @ points, points.T @ weight)
    out = np.zeros((size, x.shape[1]))
    out[kept] = left @ x
    return out.reshape(n, 2 * n_views, -1)


@pytest.mark.parametrize("slow", [0.02, 0.4])
def test_influences_agree_with_dense_matrices(walk, monkeypatch, slow):
    monkeypatch.setattr(slow_errors, "_SMOOTH_S", 0.0)
    rows, law = rows_of(walk[0], 30), NoiseLaw(slow)
    assert rows.time_s[-1] - rows.time_s[0] > 2.0
    found = correlated_influences(rows, np.zeros(30, dtype=int), law)
    found = found.reshape(30, -1, 2 * rows.n_views, found.shape[-1])
    for column in (0, 13):
        expected = dense(rows, column, law)
        np.testing.assert_allclose(found[:, column], expected, atol=1e-6 * np.abs(expected).max())


def test_pieces_of_a_recording_are_independent(walk):
    rows, law = rows_of(walk[0], 20), NoiseLaw(0.3)
    runs = (np.arange(20) >= 8).astype(int)
    whole = correlated_influences(rows, runs, law).reshape(20, -1)
    changed = rows.by_view.copy()
    changed.reshape(20, -1)[8:] = 0.0
    later = correlated_influences(Rows(**{**rows.__dict__, "by_view": changed}), runs, law).reshape(20, -1)
    np.testing.assert_allclose(whole[:8], later[:8], atol=1e-9 * np.abs(whole).max())


def test_no_slow_errors_leave_the_influences(walk, monkeypatch):
    monkeypatch.setattr(slow_errors, "_SMOOTH_S", 0.0)
    rows = rows_of(walk[0], 20)
    found = correlated_influences(rows, np.zeros(20, dtype=int), NoiseLaw(1e-9))
    np.testing.assert_allclose(found, influences(rows), atol=1e-5 * np.abs(found).max())


@pytest.mark.parametrize(("measured", "expected"), [(0.6, 0.1), (0.03, 0.03), (0.0, 1e-3)])
def test_working_correlation_has_no_more_slow_errors_than_the_residuals(measured, expected):
    assert working_law(NoiseLaw(measured)).slow == expected
