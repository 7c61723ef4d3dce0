"""Speeds of people over time."""

import numpy as np


def speeds_m_s(
    points_m: np.ndarray, time_s: np.ndarray, before: tuple[np.ndarray, float] | None
) -> tuple[np.ndarray, tuple[np.ndarray, float]]:
    """Return the speed of each person: the mean motion of the keypoints present in both this and the previous frame.

    Args:
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
        time_s: shape (frame,), ascending.
        before: points (person, keypoint, 3) and time of the frame before, None where there is none.

    Returns:
        Shape (frame, person), NaN where unknown; and the last frame's points and time.
    """
    if before is None:
        before = (np.full(points_m.shape[1:], np.nan), float("nan"))
    earlier = np.concatenate([before[0][None], points_m[:-1]])
    steps_s = np.diff(np.concatenate([[before[1]], time_s]))
    moved = points_m - earlier
    there = np.isfinite(moved).all(axis=-1, keepdims=True)
    count = there.sum(axis=2)
    mean = np.where(there, moved, 0.0).sum(axis=2) / np.maximum(count, 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = np.linalg.norm(mean, axis=-1) / steps_s[:, None]
    return np.where(count[..., 0] > 0, speed, np.nan), (points_m[-1], float(time_s[-1]))
