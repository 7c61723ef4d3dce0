"""Covariance of cameras calibrated by a board, from the variation between periods of the recording.

The corners of one image share the errors of its blur and of the board's bending, so the covariance is a sandwich with
clusters of poses that are close in time, as in :mod:`posefuse.calibration.uncertainty`.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from posefuse.calibration.adjust import descend, noise_factors
from posefuse.calibration.boards.extrinsics import BoardSolution
from posefuse.calibration.boards.intrinsics import fitted_poses
from posefuse.calibration.boards.motion_curvature import motion_curvature
from posefuse.calibration.boards.observations import CornerObservations
from posefuse.calibration.boards.parameters import LENS, free_lens
from posefuse.calibration.boards.pose_graph import connect
from posefuse.calibration.boards.shape import N_SHAPE
from posefuse.calibration.boards.shaped_model import ShapedModel, with_free_shape
from posefuse.calibration.normal_equations import NormalEquations, shared_columns
from posefuse.calibration.uncertainty import MAX_PERIODS
from posefuse.model.board import Board
from posefuse.model.cameras import Camera

_RANK_TOLERANCE = 1e-12
_MIN_RESPONSE = 0.01
_MAX_SHARE = 0.95
_POSES_PER_PERIOD = 6
_MIN_PERIODS = 8
_MIN_DEGREES = 6.0
_MAX_CORRELATION = 0.9


def joint_covariance(solution: BoardSolution) -> np.ndarray:
    """Return the covariance of all parameters, shape (view, 19, view, 19), 0 for those that are not free.

    Rotations (rad, about the camera's axes), centers (m), lens parameters and time offsets (s) are relative to the
    reference camera, whose pose and clock define the world. The error of the size of the board is not included.
    """
    free = solution.free
    columns, n_views = np.flatnonzero(free.ravel()), len(free)
    out = np.zeros((free.size, free.size))
    if len(columns):
        periods = _periods(solution)
        prior = _prior(solution)
        matrix = prior + sum(curvature for curvature, _ in periods)
        unit = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        values, vectors = np.linalg.eigh(matrix * unit * unit[:, None])
        # In these coordinates, the curvature with the prior is the identity.
        root = unit[:, None] * vectors / np.sqrt(np.maximum(values, _RANK_TOLERANCE * values[-1]))
        known = root.T @ prior @ root
        whitened = [(root.T @ curvature @ root, score @ root) for curvature, score in periods]
        # A prior contributes its curvature.
        scores = _score_covariance(whitened, solution.model.observations.n_points) + known
        response = root @ _response(solution, root, known)
        whole = response @ scores @ response.T
        out[np.ix_(columns, columns)] = whole[: len(columns), : len(columns)]
    return out.reshape(n_views, free.shape[1], n_views, free.shape[1])


def _response(solution: BoardSolution, root: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return how the cameras respond to a score if the motion of the board follows from its poses.

    Args:
        solution: the calibration.
        root: coordinates in which the curvature with the prior and with a fixed motion is the identity.
        known: the prior in these coordinates.
    """
    curvature = motion_curvature(ShapedModel(solution.model), solution.scale, with_free_shape(solution.free))
    left, values, right = np.linalg.svd(root.T @ curvature @ root + known)
    return (right.T / np.maximum(values, _MIN_RESPONSE * values[0])) @ left.T


def _periods(solution: BoardSolution) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the curvature and the score of the cameras and the shape of the board from each period of the recording.

    The score is the gradient of the cost of the corners of the period.
    """
    model, out = solution.model, []
    n, free = model.observations.n_points, with_free_shape(solution.free)
    shared = shared_columns(free, N_SHAPE)
    count = min(max(n // _POSES_PER_PERIOD, _MIN_PERIODS), MAX_PERIODS, n)
    period = np.arange(n) * count // n
    for k in range(count):
        part = ShapedModel(model.select_poses(period == k))
        rows = replace(part.rows(solution.scale), prior=None)
        normal = NormalEquations.of(rows, part.observations, len(free), rows.curvature)
        reduced = normal.reduced(np.flatnonzero(free.ravel()))
        out.append((shared.T @ reduced.matrix @ shared, shared.T @ reduced.gradient))
    return out


def _prior(solution: BoardSolution) -> np.ndarray:
    """Return the precision of the priors of the free parameters and of the shape, shape (free + 5, free + 5)."""
    free = with_free_shape(solution.free)
    shared, columns = shared_columns(free, N_SHAPE), np.flatnonzero(free.ravel())
    prior = ShapedModel(solution.model).rows(solution.scale).prior
    assert prior is not None
    whole = np.asarray(block_diag(*prior.matrices))
    return shared.T @ whole[np.ix_(columns, columns)] @ shared


def _score_covariance(periods: list[tuple[np.ndarray, np.ndarray]], n_poses: int) -> np.ndarray:
    """Return the covariance of the sum of the scores, from their variation between periods.

    Parameters follow the errors of each period, so that its score is too small; it is corrected by the share of the
    curvature that the period has (CR2: Bell and McCaffrey 2002). With fewer periods than parameters, the covariance
    would be singular: combinations of parameters would seem to be exact. It is therefore shrunk towards the curvature,
    scaled to the same mean variance, as far as it is noisy (Ledoit and Wolf 2004).

    Args:
        periods: curvature and score of each, in coordinates in which the whole curvature is the identity.
        n_poses: number of poses of the board.
    """
    corrected = []
    for curvature, score in periods:
        share, vectors = np.linalg.eigh(curvature)
        corrected.append(vectors @ ((score @ vectors) / np.sqrt(1.0 - np.clip(share, 0.0, _MAX_SHARE))))
    sums = np.array(corrected)
    count, size = sums.shape
    clustered, curvature = sums.T @ sums, sum(each for each, _ in periods)
    target = curvature * (np.trace(clustered) / max(float(np.trace(curvature)), 1e-300))
    away = float(((clustered - target) ** 2).sum())
    square = (sums**2).sum(axis=1) ** 2
    noise = max(float(square.sum() - (clustered**2).sum() / count), 0.0)
    shrink = min(noise / away, 1.0) if away > 0.0 else 1.0
    poses = n_poses / count
    factor = _persistence(periods, sums, poses)
    degrees = count / ((1.0 - shrink) ** 2 + shrink**2 / size)
    return ((1.0 - shrink) * clustered + shrink * target) * _inflation(degrees) * factor


def _persistence(periods: list[tuple[np.ndarray, np.ndarray]], sums: np.ndarray, poses: float) -> float:
    """Return by how much errors that outlast a period increase the variance of the sum of all periods.

    The correlation of successive periods gives that of successive poses, which is assumed to fall geometrically.

    Args:
        periods: curvature and score of each period.
        sums: shape (period, parameter): corrected scores.
        poses: number of poses per period.
    """
    squares, count = (sums**2).sum(), len(sums)
    if count < 2 or squares <= 0.0:
        return 1.0
    # Fitted parameters make the scores of periods without common errors negatively correlated.
    shares = [curvature for curvature, _ in periods]
    fitted = sum(float(np.sum(a * b)) for a, b in zip(shares[1:], shares[:-1], strict=True))
    fitted *= float(squares) / max(sum(float(np.trace(share)) for share in shares), 1e-300)
    together = (float(np.sum(sums[1:] * sums[:-1])) + fitted) / float(squares) * count / (count - 1)
    pose = np.linspace(0.0, _MAX_CORRELATION, 100)
    left = pose**poses
    whole = poses * (1.0 + pose) / (1.0 - pose)
    within = whole - 2.0 * pose * (1.0 - left) / (1.0 - pose) ** 2
    between = pose * (1.0 - left) ** 2 / (1.0 - pose) ** 2
    return float(np.interp(together, between / within, whole / within))


def _inflation(degrees: float) -> float:
    """Return by how much the squared error of three numbers in units of an estimated variance exceeds the true one.

    It is the mean of the inverse of a Wishart distribution with these degrees of freedom.
    """
    degrees = max(degrees, _MIN_DEGREES)
    return degrees / (degrees - 4.0)


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
    shaped, _, _ = descend(ShapedModel(model), with_free_shape(free), scale, 1e-3, 1e-6)
    return joint_covariance(BoardSolution(shaped.board, scale, free, connect([])))[0, LENS, 0, LENS]
