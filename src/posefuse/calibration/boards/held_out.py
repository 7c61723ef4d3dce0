"""Reprojection errors of frames that the cameras were not calibrated with.

Frames are held out in blocks, because neighboring images of a board are nearly equal. The cameras are adjusted without
the frames of a fold; then only the poses of the board are fitted in them, with the cameras fixed.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.adjust import descend
from posefuse.calibration.boards.extrinsics import BoardSolution
from posefuse.calibration.boards.model import BoardModel

_FOLDS = 3
_BLOCKS_PER_FOLD = 4
_MIN_POSES = 12
_MIN_CORNERS = 20
_MAX_ERROR_PX = 1e4


@dataclass(frozen=True, eq=False)
class HeldOutErrors:
    """Distances between projected and detected corners in held-out frames.

    Attributes:
        rms_px: root mean square over all corners; NaN if there are too few frames to hold some out.
        median_px: median over all corners.
        by_view_px: shape (view,): root mean square of each view.
        n_frames: number of held-out frames, over all folds.
    """

    rms_px: float
    median_px: float
    by_view_px: np.ndarray
    n_frames: int


def held_out_errors(solution: BoardSolution) -> HeldOutErrors:
    """Calibrate without each third of the frames in turn, and measure the errors there.

    Only corners in frames that two cameras share are counted: others say nothing about the poses of the cameras.
    """
    model = solution.model
    unknown = HeldOutErrors(float("nan"), float("nan"), np.full(model.n_views, np.nan), 0)
    n = model.observations.n_points
    if n < _MIN_POSES:
        return unknown
    fold = np.arange(n) * _FOLDS * _BLOCKS_PER_FOLD // n % _FOLDS
    errors, views, n_frames = [np.empty(0)], [np.empty(0, dtype=np.int64)], 0
    for k in range(_FOLDS):
        test = (fold == k) & _shared(model)
        if not test.any():
            continue
        own_errors, own_views = _fold_errors(solution, fold != k, test)
        errors.append(own_errors)
        views.append(own_views)
        n_frames += int(test.sum())
    error, view = np.concatenate(errors), np.concatenate(views)
    if not len(error):
        return unknown
    by_view = np.full(model.n_views, np.nan)
    for v in range(model.n_views):
        if np.any(view == v):
            by_view[v] = np.sqrt(np.mean(error[view == v] ** 2))
    return HeldOutErrors(float(np.sqrt(np.mean(error**2))), float(np.median(error)), by_view, n_frames)


def _shared(model: BoardModel) -> np.ndarray:
    """Return which poses two cameras see, shape (pose,), bool."""
    seen = np.zeros((model.observations.n_points, model.n_views), dtype=bool)
    seen[model.observations.point, model.observations.view] = True
    return seen.sum(axis=1) >= 2


def _fold_errors(solution: BoardSolution, train: np.ndarray, test: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors and views of the corners in the test poses."""
    left = solution.model.select_poses(train)
    # A camera without enough corners in the other frames keeps its parameters.
    counts = np.bincount(left.observations.view, minlength=left.n_views)
    free = solution.free & (counts >= _MIN_CORNERS)[:, None]
    left, _, _ = descend(left, free, solution.scale, 1e-3, 1e-6)
    held = solution.model.select_poses(test)
    held = replace(held, rig=left.rig, offset_s=left.offset_s, priors=())
    held, _, _ = descend(held, np.zeros_like(free), solution.scale, 1e-3, 1e-6)
    return np.minimum(held.errors_px(), _MAX_ERROR_PX), held.observations.view
