"""Accuracy of a calibration by a board: distances between corners that are triangulated without its shape."""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.boards.extrinsics import BoardSolution

_MIN_VIEWS = 2
_STEPS = 5
_DAMPING = 1e-9


@dataclass(frozen=True)
class Distances:
    """Distances between triangulated corners of one frame, compared with the board.

    Attributes:
        error: median of measured over true distances, minus 1.
        spread: median absolute deviation of this share.
        n_pairs: number of pairs of corners.
    """

    error: float
    spread: float
    n_pairs: int


def board_distances(solution: BoardSolution) -> Distances:
    """Triangulate every corner on its own, without the shape of the board, and compare distances with the board."""
    model, seen = solution.model, solution.model.observations
    points = _triangulated(solution)
    shares: list[np.ndarray] = []
    for k in range(seen.n_points):
        known = np.flatnonzero(np.isfinite(points[k, :, 0]))
        a, b = np.triu_indices(len(known), 1)
        measured = np.linalg.norm(points[k, known[a]] - points[k, known[b]], axis=1)
        true = np.linalg.norm(model.board.points_m[known[a]] - model.board.points_m[known[b]], axis=1)
        shares.append(measured / true)
    share = np.concatenate(shares) if shares else np.empty(0)
    if not len(share):
        return Distances(float("nan"), float("nan"), 0)
    middle = float(np.median(share))
    return Distances(middle - 1.0, float(np.median(np.abs(share / middle - 1.0))), len(share))


def _triangulated(solution: BoardSolution) -> np.ndarray:
    """Return corners triangulated by Gauss-Newton from their place on the board, shape (pose, corner, 3)."""
    model, seen = solution.model, solution.model.observations
    n = len(model.board.points_m)
    index = seen.point * n + seen.corner
    used, number = np.unique(index, return_inverse=True)
    views = np.zeros((len(used), model.n_views), dtype=bool)
    views[number, seen.view] = True
    enough = views.sum(axis=1) >= _MIN_VIEWS
    change = np.zeros((len(used), 3))
    for _ in range(_STEPS):
        residual, by_point = model.point_rows(change[number], solution.scale)
        matrix, gradient = np.zeros((len(used), 3, 3)), np.zeros((len(used), 3))
        np.add.at(matrix, number, by_point.transpose(0, 2, 1) @ by_point)
        np.add.at(gradient, number, (residual[:, None] @ by_point)[:, 0])
        matrix[~enough] = np.eye(3)
        damping = _DAMPING * np.trace(matrix, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        step = np.linalg.solve(matrix + damping, -gradient[:, :, None])
        change[enough] += step[enough, :, 0]
    out = np.full((seen.n_points, n, 3), np.nan)
    kept = used[enough]
    out.reshape(-1, 3)[kept] = model.corner_places().reshape(-1, 3)[kept] + change[enough]
    return out
