"""Accelerations and variation of bone lengths."""

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Jitter:
    """Median accelerations over the same points and frames. NaN if no point is matched in three consecutive frames.

    Attributes:
        result_m_s2: median acceleration of the result.
        truth_m_s2: median acceleration of the truth.
        ratio: result over truth; NaN also for a stationary truth.
        n: number of accelerations.
    """

    result_m_s2: float
    truth_m_s2: float
    ratio: float
    n: int


def accelerations_m_s2(points_m: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return the magnitudes of acceleration over three consecutive frames.

    Args:
        points_m: shape (frame, person, keypoint, 3).
        time_s: shape (frame,), increasing.

    Returns:
        Shape (frame - 2, person, keypoint); NaN where a point is missing, and across gaps in time.
    """
    if len(points_m) < 3:
        return np.full((0, *points_m.shape[1:3]), np.nan)
    steps = np.diff(time_s)
    velocity = np.diff(points_m, axis=0) / steps[:, None, None, None]
    mean_step = 0.5 * (steps[1:] + steps[:-1])
    size = np.linalg.norm(np.diff(velocity, axis=0) / mean_step[:, None, None, None], axis=-1)
    size[np.maximum(steps[1:], steps[:-1]) > 1.5 * np.median(steps)] = np.nan
    return size


def jitter(matched_m: np.ndarray, truth_m: np.ndarray, person: np.ndarray, time_s: np.ndarray) -> Jitter:
    """Compare the accelerations of result and truth where both are defined.

    Args:
        matched_m: shape (frame, truth, keypoint, 3): points of the result for each person of the truth.
        truth_m: points of the truth, same shape.
        person: shape (frame, truth), int64: matched person of the result, -1 for none; a change is not motion.
        time_s: shape (frame,).
    """
    ours, true = accelerations_m_s2(matched_m, time_s), accelerations_m_s2(truth_m, time_s)
    one = (person[2:] == person[1:-1]) & (person[1:-1] == person[:-2]) & (person[2:] >= 0)
    both = np.isfinite(ours) & np.isfinite(true) & one[..., None]
    if not both.any():
        return Jitter(math.nan, math.nan, math.nan, 0)
    medians = float(np.median(ours[both])), float(np.median(true[both]))
    return Jitter(*medians, medians[0] / medians[1] if medians[1] > 0 else math.nan, int(both.sum()))


def bone_spreads(points_m: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the variation of each bone: 1.48 times the median absolute deviation over the median length.

    Args:
        points_m: shape (frame, person, keypoint, 3).
        edges: shape (edge, 2).

    Returns:
        Shape (edge,): median over people; NaN for bones seen less than twice.
    """
    found = np.full((len(edges), points_m.shape[1]), np.nan)
    for e, (a, b) in enumerate(edges):
        lengths = np.linalg.norm(points_m[:, :, a] - points_m[:, :, b], axis=-1)
        for p, of_one in enumerate(lengths.T):
            seen = of_one[np.isfinite(of_one)]
            middle = float(np.median(seen)) if len(seen) > 1 else 0.0
            if middle > 0:
                found[e, p] = 1.4826 * np.median(np.abs(seen - middle)) / middle
    spreads = np.full(len(edges), np.nan)
    known = np.isfinite(found).any(axis=1)
    spreads[known] = np.nanmedian(found[known], axis=1)
    return spreads
