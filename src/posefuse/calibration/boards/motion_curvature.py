"""How the equations of a calibration change with its parameters if the motion of the board follows from its poses.

An adjustment holds the motion fixed, and repeats until it agrees with the poses. Its result solves these equations, so
errors of the corners pass to the cameras by their derivatives (M-estimation: Huber 1967), in which a pose also moves
the corners that are seen shortly before or after its neighbors. Where cameras are determined weakly, this matters much.
"""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from posefuse.calibration.boards.model import BoardModel, Motion
from posefuse.calibration.boards.shape import N_SHAPE
from posefuse.calibration.boards.shaped_model import ShapedModel
from posefuse.calibration.normal_equations import shared_columns

_REACH = 2
_NEIGHBORS = np.arange(-_REACH, _REACH + 1)
_SMALL = 1e-12


def motion_curvature(model: ShapedModel, scale: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the derivative of the equations of the cameras by their parameters, with the poses eliminated.

    It is not symmetric; without motion, it is the curvature of the cost.

    Args:
        model: cameras, poses and shape of the board.
        scale: shape (view,): noise factors.
        free: shape (view, 24), bool: free parameters.

    Returns:
        Shape (free, free), with one column for each parameter that all views share, without priors.
    """
    rows, seen = model.rows(scale), model.observations
    root = np.sqrt(rows.curvature)[:, None, None]
    by_camera = _sparse(root * rows.by_camera, seen.view[:, None], model.n_views)
    by_camera = (by_camera[:, np.flatnonzero(free.ravel())] @ csr_matrix(shared_columns(free, N_SHAPE))).tocsr()
    by_point = root * rows.by_point
    weights, poses = pose_weights(model.board)
    held = _sparse(by_point, seen.point[:, None], seen.n_points)
    moving = _sparse((weights[:, None, :, None] * by_point[:, :, None]).reshape(len(root), 2, -1), poses, seen.n_points)
    of_poses = (held.T @ moving).tolil()
    of_poses.setdiag(of_poses.diagonal() * (1.0 + _SMALL) + _SMALL)
    mixed = (held.T @ by_camera).toarray()
    cameras = (by_camera.T @ by_camera).toarray()
    return np.asarray(cameras - (by_camera.T @ moving) @ splu(of_poses.tocsc()).solve(mixed))


def pose_weights(model: BoardModel) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much each observed corner follows the poses around its own: these interpolate its place.

    Returns:
        Weights and indices of the poses, both of shape (observation, 5); the weight is 0 where there is no such pose.
    """
    seen, n = model.observations, model.observations.n_points
    near = seen.point[:, None] + _NEIGHBORS
    weights = np.zeros(near.shape)
    if model.motion.velocity.any():
        lag_s = (seen.delay_s + model.offset_s[seen.view])[:, None]
        # The motion is linear in the poses: a shift of every fifth pose shows the weight of each.
        own = (np.arange(n)[:, None] % len(_NEIGHBORS) == np.arange(2 * 3)).astype(np.float64)
        still = np.repeat(np.eye(3)[None], n, axis=0)
        parts = [Motion.of(still, shifted, seen.time_s).at(seen.point) for shifted in (own[:, :3], own[:, 3:])]
        all_weights = np.hstack([(each.velocity + 0.5 * each.acceleration * lag_s) * lag_s for each in parts])
        weights = np.take_along_axis(all_weights, near % len(_NEIGHBORS), axis=1)
    weights[:, _REACH] += 1.0
    weights[(near < 0) | (near >= n)] = 0.0
    return weights, np.clip(near, 0, n - 1)


def _sparse(values: np.ndarray, block: np.ndarray, n_blocks: int) -> csr_matrix:
    """Return derivatives as a matrix.

    Args:
        values: shape (observation, 2, size * b): derivatives by b blocks of parameters.
        block: shape (observation, b): the blocks.
        n_blocks: number of blocks.
    """
    n, _, width = values.shape
    size = width // block.shape[1]
    column = (block[:, :, None] * size + np.arange(size)).reshape(n, width)
    columns = np.repeat(column[:, None], 2, axis=1).ravel()
    return csr_matrix((values.ravel(), columns, np.arange(0, values.size + 1, width)), shape=(2 * n, n_blocks * size))
