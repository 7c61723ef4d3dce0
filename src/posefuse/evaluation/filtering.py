"""What a filter did to the reprojection errors: before and after, along every axis."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import is_used

HIGH = 95.0
"""The percentile beside the mean: a mean hardly moves when few errors are removed."""


@dataclass(frozen=True, eq=False)
class ErrorProfile:
    """Reprojection errors over the views used, along each axis. NaN where there are none.

    Attributes:
        frame_numbers: shape (frame,): numbers of the frames in the recording.
        frame_mean_px: shape (frame,): mean over keypoints and views.
        view_mean_px: shape (view,).
        view_p95_px: shape (view,): 95 % of the errors are at most so large.
        keypoint_mean_px: shape (keypoint,).
        keypoint_p95_px: shape (keypoint,).
        missing_share: of the points, those without coordinates.
    """

    frame_numbers: np.ndarray
    frame_mean_px: np.ndarray
    view_mean_px: np.ndarray
    view_p95_px: np.ndarray
    keypoint_mean_px: np.ndarray
    keypoint_p95_px: np.ndarray
    missing_share: float


def error_profile(parts: Iterable[Reconstruction]) -> ErrorProfile:
    """Gather the measured layer's errors from consecutive ranges of frames."""
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
    """Shape (row,): mean of what is there; NaN where nothing is."""
    there = np.isfinite(rows)
    with np.errstate(invalid="ignore"):
        return np.where(there, rows, 0.0).sum(axis=1, dtype=np.float64) / there.sum(axis=1)


def _high(rows: np.ndarray) -> np.ndarray:
    """Shape (row,): the 95 % percentile of what is there; NaN where nothing is."""
    return np.array([np.percentile(row[there], HIGH) if (there := np.isfinite(row)).any() else np.nan for row in rows])
