"""Linearized reprojection: residuals and their derivatives at given points."""

import math

import numpy as np

from posefuse.kernels.cameras.lens import OK
from posefuse.kernels.cameras.observation_rows import BLOCK, residual, rows_block
from posefuse.kernels.jit import inline, kernel


@kernel
def linearize(cameras, points, pixels, residuals, jacobians):
    """Compute residuals of observations at points, and their derivatives with respect to the points.

    They are those of the observation rows: exact without distortion, and first order in the residual with distortion.

    Args:
        cameras: the camera array.
        points: shape (point, 3), in the world.
        pixels: shape (point, view, 2), NaN where missing.
        residuals: shape (point, view, 2), written: projected minus observed, px; NaN where undefined.
        jacobians: shape (point, view, 2, 3), written: derivatives of the residuals, px per unit; NaN where undefined.
    """
    n_views = cameras.shape[0]
    block = np.empty((n_views, 2, BLOCK))
    codes = np.empty((n_views, BLOCK), np.int64)
    rows = np.empty((n_views, 12, BLOCK))
    scratch = np.empty((6, BLOCK))
    for first in range(0, points.shape[0], BLOCK):
        size = min(BLOCK, points.shape[0] - first)
        for v in range(n_views):
            for j in range(BLOCK):
                n = first + min(j, size - 1)
                block[v, 0, j] = pixels[n, v, 0]
                block[v, 1, j] = pixels[n, v, 1]
            rows_block(cameras, v, block, codes, rows, scratch)
            for j in range(size):
                _store(rows, v, j, codes[v, j] == OK, points, first + j, residuals, jacobians)


@inline
def _store(rows, v, j, valid, points, n, residuals, jacobians):
    """Write the residual and its derivative for one point and one view."""
    depth, r, s = residual(rows, v, j, points[n, 0], points[n, 1], points[n, 2])
    valid = valid and depth > 0.0
    inverse = 1.0 / depth if valid else math.nan
    residuals[n, v, 0] = r if valid else math.nan
    residuals[n, v, 1] = s if valid else math.nan
    for i in range(3):
        jacobians[n, v, 0, i] = (rows[v, i, j] - r * rows[v, 8 + i, j]) * inverse
        jacobians[n, v, 1, i] = (rows[v, 4 + i, j] - s * rows[v, 8 + i, j]) * inverse
