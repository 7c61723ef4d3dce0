"""Intrinsics of one camera from images of a board.

Starts from Zhang's closed form, adjusts lens and poses together, and chooses the lens model that predicts corners of
held-out images best.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.adjust import descend, estimate
from posefuse.calibration.boards.model import BoardModel, single
from posefuse.calibration.boards.observations import CornerObservations
from posefuse.calibration.boards.parameters import (
    DISTORTION,
    FOCAL,
    N_PARAMETERS,
    LensPrior,
    free_lens,
    with_lens,
)
from posefuse.calibration.boards.plane_pose import focal_px, homography, pose_of_plane
from posefuse.calibration.normal_equations import STUDENT_T_DOF
from posefuse.errors import CalibrationError
from posefuse.model.board import Board
from posefuse.model.cameras import Camera, LensModel

LENSES = (LensModel.BROWN, LensModel.RATIONAL, LensModel.FISHEYE)
"""Lens models to choose from, the simplest first."""

MIN_IMAGES = 4
_MAX_IMAGES = 60
_MAX_FOLD_IMAGES = 24
_GRID = (12, 8)
_FOLDS = 3
_START_SHARES = (1.0, 0.6, 0.35)
_START_ERROR = 20.0
_MIN_GAIN = 0.1
_CORNER_PX = 0.2


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """Intrinsics of one camera.

    Attributes:
        camera: the camera; its pose is that of the rig's world only after the extrinsics.
        covered: shape (rows, columns) of the image grid, bool: cells in which corners were found.
        n_images: number of images used.
        held_out_px: median error of corners in held-out images, for the chosen lens model.
        given: whether the intrinsics were given and not estimated.
    """

    camera: Camera
    covered: np.ndarray
    n_images: int
    held_out_px: float
    given: bool = False


def estimate_intrinsics(
    name: str,
    size_px: tuple[int, int],
    board: Board,
    corners: CornerObservations,
    lenses: tuple[LensModel, ...] = LENSES,
) -> Intrinsics:
    """Estimate the intrinsics of one camera.

    Args:
        name: name of the camera.
        size_px: width and height of its images.
        board: the board.
        corners: corners seen by this camera only (``corners.of_view(v)``).
        lenses: lens models to choose from.

    Raises:
        CalibrationError: if too few images show the board, or it was always seen frontally.
    """
    covered = coverage(corners, size_px)
    chosen = corners.select_poses(spread_poses(corners, size_px, _MAX_IMAGES))
    if chosen.n_points < MIN_IMAGES:
        raise CalibrationError(
            f"Camera {name!r} shows the board in {chosen.n_points} images; its lens needs at least {MIN_IMAGES}. Film "
            "the board close to this camera, at different angles, or give the lens with `intrinsics`."
        )
    start = _first_camera(name, size_px, board, chosen)
    few = chosen.select_poses(spread_poses(chosen, size_px, _MAX_FOLD_IMAGES))
    scores = {lens: _held_out(start, lens, board, few) for lens in lenses}
    best = lenses[0]
    for lens in lenses[1:]:
        if scores[lens][0] < (1.0 - _MIN_GAIN) * scores[best][0]:
            best = lens
    camera = _fit(with_lens(start, best), board, chosen)
    return Intrinsics(camera, covered, chosen.n_points, scores[best][1])


def coverage(corners: CornerObservations, size_px: tuple[int, int]) -> np.ndarray:
    """Return which cells of an image grid contain corners, shape (rows, columns), bool."""
    covered = np.zeros(_GRID[::-1], dtype=bool)
    column, row = _cells(corners, size_px)
    covered[row, column] = True
    return covered


def _cells(corners: CornerObservations, size_px: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return column and row of the image grid of each corner."""
    share = np.clip((corners.pixels + 0.5) / np.array(size_px), 0.0, 1.0 - 1e-9)
    column, row = (share * np.array(_GRID)).astype(np.int64).T
    return column, row


def spread_poses(corners: CornerObservations, size_px: tuple[int, int], most: int) -> np.ndarray:
    """Choose images whose corners cover the image evenly; a greedy choice, shape (pose,), bool."""
    column, row = _cells(corners, size_px)
    cells = np.zeros((corners.n_points, _GRID[0] * _GRID[1]), dtype=bool)
    cells[corners.point, row * _GRID[0] + column] = True
    chosen = np.zeros(corners.n_points, dtype=bool)
    counts = np.zeros(cells.shape[1])
    for _ in range(min(most, corners.n_points)):
        gain = np.where(chosen, -1.0, cells @ (1.0 / (1.0 + counts) ** 2))
        k = int(np.argmax(gain))
        chosen[k] = True
        counts += cells[k]
    return chosen


def _first_camera(name: str, size_px: tuple[int, int], board: Board, corners: CornerObservations) -> Camera:
    """Return a camera without distortion, its focal length from homographies."""
    center = ((size_px[0] - 1) / 2, (size_px[1] - 1) / 2)
    found = [
        homography(board.points_m[corners.corner[rows], :2], corners.pixels[rows])
        for rows in (corners.point == k for k in range(corners.n_points))
    ]
    focal = focal_px([h for h in found if h is not None], center)
    side = max(size_px)
    focal = float(np.clip(focal if focal is not None else side, 0.2 * side, 20.0 * side))
    matrix = np.array([[focal, 0.0, center[0]], [0.0, focal, center[1]], [0.0, 0.0, 1.0]])
    return Camera(name, size_px, matrix, np.eye(4))


def _fit(start: Camera, board: Board, corners: CornerObservations) -> Camera:
    """Adjust the lens of a camera from several initial focal lengths, and return the best."""
    best: tuple[float, Camera] | None = None
    for share in _START_SHARES if start.lens is LensModel.FISHEYE else _START_SHARES[:1]:
        matrix = start.matrix * np.array([[share, 1, 1], [1, share, 1], [1, 1, 1]])
        model = at_poses(replace(start, matrix=matrix), board, corners)
        if model is None:
            continue
        free = free_lens(start)
        simple = free.copy()
        simple[DISTORTION] = False
        simple[FOCAL.stop : DISTORTION.start] = False
        scale = np.full(1, _START_ERROR)
        model, _, _ = descend(model, simple[None], scale, 1e-3, 1e-3)
        model, scale, rows = estimate(model, free[None], _START_ERROR)
        likelihood = rows.cost + 2.0 * len(rows.squared) * float(np.log(scale[0]))
        if best is None or likelihood < best[0]:
            best = likelihood, model.rig.cameras[0]
    if best is None:
        raise CalibrationError(
            f"Camera {start.name!r} sees no image of the board that determines its pose. Film the board at different "
            "angles to the camera."
        )
    return best[1]


def at_poses(camera: Camera, board: Board, corners: CornerObservations) -> BoardModel | None:
    """Return the model of one camera with the poses of its homographies; without images that give none."""
    poses = [
        pose_of_plane(camera, board.points_m[corners.corner[rows], :2], corners.pixels[rows])
        for rows in (corners.point == k for k in range(corners.n_points))
    ]
    known = np.array([pose is not None for pose in poses])
    if not known.any():
        return None
    rotations = np.array([pose[0] for pose in poses if pose is not None])
    origins = np.array([pose[1] for pose in poses if pose is not None])
    rig = single(camera)
    prior = LensPrior.of(camera)
    return BoardModel.at_rest(rig, rotations, origins, board, corners.select_poses(known), (prior,))


def fitted_poses(camera: Camera, board: Board, corners: CornerObservations) -> BoardModel | None:
    """Return the model of one camera with a fixed lens and adjusted poses."""
    model = at_poses(camera, board, corners)
    if model is None:
        return None
    fixed = np.zeros((1, N_PARAMETERS), dtype=bool)
    for scale in (5.0, 1.0):
        model, _, _ = descend(model, fixed, np.full(1, scale), 1e-3, 1e-6)
    return model


def _held_out(start: Camera, lens: LensModel, board: Board, corners: CornerObservations) -> tuple[float, float]:
    """Return the mean robust cost and the median error (px) of corners in images that the lens was not fitted to."""
    errors = []
    for fold in range(_FOLDS):
        test = np.arange(corners.n_points) % _FOLDS == fold
        camera = _fit(with_lens(start, lens), board, corners.select_poses(~test))
        model = fitted_poses(camera, board, corners.select_poses(test))
        if model is not None:
            errors.append(model.errors_px())
    if not errors:
        return float("inf"), float("nan")
    all_errors = np.concatenate(errors)
    cost = np.log1p((all_errors / _CORNER_PX) ** 2 / STUDENT_T_DOF).mean()
    return float(cost), float(np.median(all_errors))
