"""Covariance of cameras calibrated by a board, from the variation between periods of the recording.

The corners of one image share the errors of its blur and of the board's bending, so the covariance is a sandwich with
clusters of poses that are close in time, as in :mod:`posefuse.calibration.uncertainty`.
"""

import numpy as np

from posefuse.calibration.adjust import descend, noise_factors
from posefuse.calibration.boards.extrinsics import BoardSolution
from posefuse.calibration.boards.intrinsics import fitted_poses
from posefuse.calibration.boards.observations import CornerObservations
from posefuse.calibration.boards.parameters import CENTER, LENS, OFFSET, coefficient_names, free_lens
from posefuse.calibration.boards.pose_graph import connect
from posefuse.calibration.normal_equations import NormalEquations
from posefuse.calibration.uncertainty import MAX_PERIODS, cluster_covariance
from posefuse.model import camera_covariance as names
from posefuse.model.board import Board
from posefuse.model.camera_covariance import CameraCovariance
from posefuse.model.cameras import Camera

_RANK_TOLERANCE = 1e-12


def joint_covariance(solution: BoardSolution) -> np.ndarray:
    """Return the covariance of all parameters, shape (view, 19, view, 19), 0 for those that are not free.

    Rotations (rad, about the camera's axes), centers (m), lens parameters and time offsets (s) are relative to the
    reference camera, whose pose and clock define the world.
    """
    free = solution.free
    columns, n_views = np.flatnonzero(free.ravel()), len(free)
    out = np.zeros((free.size, free.size))
    if len(columns):
        rows, observations = solution.rows, solution.model.observations
        normal = NormalEquations.of(rows, observations, n_views, rows.curvature)
        reduced = normal.reduced(columns)
        unit = 1.0 / np.sqrt(np.maximum(np.diag(reduced.matrix), 1e-300))
        values, vectors = np.linalg.eigh(reduced.matrix * unit * unit[:, None])
        inverse = (vectors / np.maximum(values, _RANK_TOLERANCE * values[-1])) @ vectors.T
        spread = inverse * unit * unit[:, None]
        n = observations.n_points
        period = np.arange(n) * min(MAX_PERIODS, n) // n
        scores = normal.scores(columns, reduced)
        middle = cluster_covariance(scores, period)
        # A prior contributes its curvature, as do the observations where there are too few periods to compare.
        middle = scores.T @ scores if middle is None else middle
        if rows.prior is not None:
            prior = np.zeros((n_views, free.shape[1], n_views, free.shape[1]))
            prior[np.arange(n_views), :, np.arange(n_views)] = rows.prior.matrices
            middle = middle + prior.reshape(free.size, free.size)[np.ix_(columns, columns)]
        out[np.ix_(columns, columns)] = spread @ middle @ spread
    return out.reshape(n_views, free.shape[1], n_views, free.shape[1])


def stated_covariances(solution: BoardSolution, covariance: np.ndarray) -> tuple[CameraCovariance, ...]:
    """Return the covariances of the cameras' estimated parameters, with the shifts of the centers in camera axes.

    Args:
        solution: the solution.
        covariance: shape (view, 19, view, 19), of :func:`joint_covariance`.
    """
    cameras = solution.model.rig.cameras
    out = []
    for v, (camera, free) in enumerate(zip(cameras, solution.free[:, :OFFSET], strict=True)):
        all_names = (*names.ROTATION, *names.CENTER, *names.MATRIX, *coefficient_names(camera.lens))
        used = np.flatnonzero(free[: len(all_names)])
        if len(used):
            turn = np.eye(covariance.shape[1])
            turn[CENTER, CENTER] = camera.rotation
            matrix = (turn @ covariance[v, :, v] @ turn.T)[np.ix_(used, used)]
            parameters = tuple(all_names[i] for i in used)
            out.append(CameraCovariance(camera.name, parameters, 0.5 * (matrix + matrix.T), cameras[0].name))
    return tuple(out)


def lens_covariance(camera: Camera, board: Board, corners: CornerObservations) -> np.ndarray:
    """Return the covariance of a lens that was estimated from images of a board, shape (12, 12).

    Args:
        camera: the camera with the estimated lens.
        board: the board.
        corners: corners seen by this camera only.
    """
    model = fitted_poses(camera, board, corners)
    if model is None:
        return np.zeros((LENS.stop - LENS.start,) * 2)
    free = free_lens(camera)[None]
    scale = noise_factors(model.rows(np.ones(1)), np.ones(1), model.observations)
    model, rows, _ = descend(model, free, scale, 1e-3, 1e-6)
    return joint_covariance(BoardSolution(model, scale, rows, free, connect([])))[0, LENS, 0, LENS]
