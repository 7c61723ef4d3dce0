"""Reprojection errors before and after a filter, along every axis."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import is_used

HIGH = 95.0
"""Percentile reported with the mean, which hardly changes when few errors are removed."""


@dataclass(frozen=True, eq=False)
class ErrorProfile:
    """Reprojection errors over the used views, along each axis. NaN without errors.

    Attributes:
        frame_numbers: shape (frame,): frame numbers of the recording.
        frame_mean_px: shape (frame,): mean over keypoints and views.
        view_mean_px: shape (view,): mean.
        view_p95_px: shape (view,): 95th percentile.
        keypoint_mean_px: shape (keypoint,): mean.
        keypoint_p95_px: shape (keypoint,): 95th percentile.
        missing_share: fraction of points without coordinates.
    """

    frame_numbers: np.ndarray
    frame_mean_px: np.ndarray
    view_mean_px: np.ndarray
    view_p95_px: np.ndarray
    keypoint_mean_px: np.ndarray
    keypoint_p95_px: np.ndarray
    missing_share: float


def error_profile(parts: Iterable[Reconstruction]) -> ErrorProfile:
    """Collect the measured layer's errors from consecutive ranges of frames."""
    numbers, gathered, present = [], [], []
    for part in parts:
        layer = part.layers["measured"]
        used = is_used(np.asarray(layer.view_status[:]))
        gathered.append(np.where(used, np.asarray(layer.view_error_px[:]), np.nan))
        present.append(layer.has_point)
        numbers.append(part.frame_numbers)
    errors = np.concatenate(gathered)  # (frame, person, keypoint, view)
    by_frame, by_keypoint, by_view = (
        np.moveaxis(errors, axis, 0).reshape(errors.shape[axis], -1) for axis in (0, 2, 3)
    )
    return ErrorProfile(
        frame_numbers=np.concatenate(numbers),
        frame_mean_px=_mean(by_frame),
        view_mean_px=_mean(by_view),
        view_p95_px=_high(by_view),
        keypoint_mean_px=_mean(by_keypoint),
        keypoint_p95_px=_high(by_keypoint),
        missing_share=float(1.0 - np.concatenate(present).mean()),
    )


def _mean(rows: np.ndarray) -> np.ndarray:
    """Return the mean of the finite values per row, NaN without any."""
    there = np.isfinite(rows)
    with np.errstate(invalid="ignore"):
        return np.where(there, rows, 0.0).sum(axis=1, dtype=np.float64) / there.sum(axis=1)


def _high(rows: np.ndarray) -> np.ndarray:
    """Return the 95th percentile of the finite values per row, NaN without any."""
    return np.array([np.percentile(row[there], HIGH) if (there := np.isfinite(row)).any() else np.nan for row in rows])
