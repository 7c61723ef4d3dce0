"""Covariance of the score under errors that are correlated over time, and the information of the keypoints."""

import numpy as np

from posefuse.calibration.joint.equations import Rows
from posefuse.calibration.joint.noise_law import FAST_S, SLOW_S, NoiseLaw
from posefuse.kernels.calibration.joint import decaying_sums

_MOST_SIMILAR = 50.0


def score_covariance(rays: np.ndarray, rows: Rows, law: NoiseLaw) -> np.ndarray:
    """Return the covariance of the score, shape (parameter, parameter).

    Args:
        rays: shape (point, view, 2, parameter): influence of every error on the score.
        rows: residuals, which give the variance of the errors.
        law: correlation of the errors.
    """
    size = rays.shape[-1]
    sd = score_sds(rows)
    streams = (rays * sd[:, None, None]).reshape(len(rows.frames), rows.points_m.shape[1], -1)
    if law.mixing is not None:
        streams = law.mixing.T @ streams
    streams = streams.reshape(len(rows.frames), -1, size)
    fast, slow = (_decaying(streams, rows.time_s, reach_s) for reach_s in (FAST_S, SLOW_S))
    return (1.0 - law.slow) * fast + law.slow * slow


def score_sds(rows: Rows) -> np.ndarray:
    """Return the standard deviation of the scores of each view, shape (view,), corrected for what points absorb."""
    left = np.clip(1.0 - rows.leverage(), 0.05, 1.0)
    squared = 0.5 * np.square(rows.scores).sum(axis=-1)
    out = np.ones(rows.n_views)
    for v in range(rows.n_views):
        known = rows.seen[:, v]
        if known.any():
            out[v] = np.sqrt(squared[known, v].sum() / left[known, v].sum())
    return out


def information(
    basis: np.ndarray, curvature: np.ndarray, spread: np.ndarray, pull: np.ndarray, change: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the information of the keypoints alone, and its product with the most likely changes.

    The information is the inverse of the sandwich without the prior: ``H S^-1 H``. The most likely changes x follow
    from the estimate with prior P, ``(H + P) change = H x``: neither needs the inverse of a curvature that may be 0.

    Args:
        basis: shape (parameter, free): directions that the data can determine.
        curvature: shape (parameter, parameter): H.
        spread: shape (parameter, parameter): covariance of the score, S.
        pull: shape (parameter,): slope of the prior's cost, ``P (change - mean)``.
        change: shape (parameter,): estimate.
    """
    values, vectors = np.linalg.eigh(basis.T @ curvature @ basis)
    inside = (vectors * np.maximum(values, 0.0)) @ vectors.T
    values, vectors = np.linalg.eigh(basis.T @ spread @ basis)
    half = (vectors / np.sqrt(np.maximum(values, 1e-9 * values[-1] + 1e-300))) @ vectors.T
    inner = half @ inside
    whole = inside @ (basis.T @ change) + basis.T @ pull
    return inner.T @ inner, inner.T @ (half @ whole)


def _decaying(streams: np.ndarray, time_s: np.ndarray, reach_s: float) -> np.ndarray:
    """Return the sum over all pairs of times of products that decay exponentially with the time between them."""
    decay = np.exp(-np.diff(time_s, prepend=time_s[:1]) / reach_s)
    summed = np.empty_like(streams)
    decaying_sums(np.ascontiguousarray(streams), decay, summed)
    flat, later = streams.reshape(-1, streams.shape[-1]), summed.reshape(-1, streams.shape[-1])
    cross = flat.T @ later
    return cross + cross.T - flat.T @ flat


def design_effect(basis: np.ndarray, curvature: np.ndarray, spread: np.ndarray) -> float:
    """Return how many observations with these errors count as one independent observation, 1 to ``_MOST_SIMILAR``.

    It is that of the quarter of the directions in which errors add up most.

    Args:
        basis: shape (parameter, free): directions that the data can determine.
        curvature: shape (parameter, parameter).
        spread: shape (parameter, parameter): covariance of the score.
    """
    values, vectors = np.linalg.eigh(basis.T @ spread @ basis)
    half = vectors / np.sqrt(np.maximum(values, 1e-9 * values[-1] + 1e-300))
    shares = np.linalg.eigvalsh(half.T @ (basis.T @ curvature @ basis) @ half)
    return float(1.0 / np.clip(np.quantile(shares, 0.25), 1.0 / _MOST_SIMILAR, 1.0))
