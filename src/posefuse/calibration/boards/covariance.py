"""Covariance of cameras calibrated by a board, from the variation between periods of the recording.

The corners of one image share the errors of its blur and of the board's bending, so the covariance is a sandwich with
clusters of poses that are close in time, as in :mod:`posefuse.calibration.uncertainty`.
"""

import numpy as np

from posefuse.calibration.boards.extrinsics import BoardSolution
from posefuse.calibration.normal_equations import NormalEquations
from posefuse.calibration.uncertainty import MAX_PERIODS, cluster_covariance

_RANK_TOLERANCE = 1e-12


def camera_covariance(solution: BoardSolution) -> np.ndarray:
    """Return the covariance of the parameters of each camera, shape (view, 19, 19), 0 for those that are not free.

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
    blocks = out.reshape(n_views, free.shape[1], n_views, free.shape[1])
    return blocks[np.arange(n_views), :, np.arange(n_views)]
