"""Covariance of cameras calibrated by a board, from the variation between periods of the recording.

The corners of one image share the errors of its blur and of the board's bending, so the covariance is a sandwich with
clusters of poses that are close in time, as in :mod:`posefuse.calibration.uncertainty`.
"""

import numpy as np

from posefuse.calibration.adjust import descend, noise_factors
from posefuse.calibration.boards.extrinsics import BoardSolution
from posefuse.calibration.boards.intrinsics import fitted_poses
from posefuse.calibration.boards.observations import CornerObservations
from posefuse.calibration.boards.parameters import LENS, free_lens
from posefuse.calibration.boards.pose_graph import connect
from posefuse.calibration.normal_equations import NormalEquations
from posefuse.calibration.uncertainty import MAX_PERIODS, cluster_covariance
from posefuse.model.board import Board
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
        prior = np.zeros((n_views, free.shape[1], n_views, free.shape[1]))
        if rows.prior is not None:
            prior[np.arange(n_views), :, np.arange(n_views)] = rows.prior.matrices
        # A prior contributes its curvature.
        known = prior.reshape(free.size, free.size)[np.ix_(columns, columns)]
        middle = _score_covariance(normal.scores(columns, reduced), reduced.matrix - known, spread)
        out[np.ix_(columns, columns)] = spread @ (middle + known) @ spread
    return out.reshape(n_views, free.shape[1], n_views, free.shape[1])


def _score_covariance(scores: np.ndarray, curvature: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Return the covariance of the sum of the scores of the poses of the board, from its variation between periods.

    With fewer periods than parameters, it would be singular: combinations of parameters would seem to be exact. It is
    therefore shrunk towards the curvature, scaled to the same mean variance (Ledoit and Wolf 2004).

    Args:
        scores: shape (pose, parameter).
        curvature: shape (parameter, parameter): of the observations.
        spread: shape (parameter, parameter): inverse of the curvature with the prior.
    """
    n, size = scores.shape
    n_periods = min(MAX_PERIODS, n)
    clustered = cluster_covariance(scores, np.arange(n) * n_periods // n)
    clustered = scores.T @ scores if clustered is None else clustered
    expected = float(np.sum(spread * curvature))
    factor = float(np.sum(spread * clustered)) / expected if expected > 0.0 else 0.0
    share = size / (size + n_periods)
    return (1.0 - share) * clustered + share * factor * curvature


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
