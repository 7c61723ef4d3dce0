"""How a real board differs from its description: it is bent, and its squares are stretched.

These few numbers are common to all images. They are estimated together with the cameras, with Gaussian priors, because
a bend of half a millimeter moves cameras by more than the noise of many images does. The size of the board as a whole
is not among them: it is the only scale of the recording.
"""

import numpy as np

from posefuse.model.board import Board

N_SHAPE = 5
"""Bends along x, y and both (m at the ends of the longer side), the difference of the stretches of x and y, shear."""

_BENT_SHARE = 2e-3
_STRETCHED = 1e-3


def shape_directions(board: Board) -> np.ndarray:
    """Return how the corners of a board move with each number of its shape, shape (corner, 3, 5)."""
    out = np.zeros((len(board.points_m), 3, N_SHAPE))
    away = board.points_m[:, :2] - board.points_m[:, :2].mean(axis=0)
    x, y = away.T
    half_m = np.abs(away).max()
    out[:, 2, 0], out[:, 2, 1], out[:, 2, 2] = (x / half_m) ** 2, (y / half_m) ** 2, x * y / half_m**2
    out[:, 0, 3], out[:, 1, 3] = 0.5 * x, -0.5 * y
    out[:, 0, 4], out[:, 1, 4] = 0.5 * y, 0.5 * x
    return out


def shape_precision(board: Board) -> np.ndarray:
    """Return the precision of the prior of each number, shape (5,)."""
    side_m = np.ptp(board.points_m[:, :2], axis=0).max()
    return 1.0 / np.square([_BENT_SHARE * side_m] * 3 + [_STRETCHED] * 2)
