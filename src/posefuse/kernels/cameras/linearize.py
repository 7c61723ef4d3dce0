"""Reprojection made linear at given points: residuals and their derivatives."""

import math

import numpy as np

from posefuse.kernels.cameras.lens import OK
from posefuse.kernels.cameras.observation_rows import BLOCK, residual, rows_block
from posefuse.kernels.jit import inline, kernel


@kernel
def linearise(cameras, distorted, fisheye, points, pixels, residuals, jacobians):
    """Residuals of observations at points, and how they change with the points.

    They are those of observation rows: exact without distortion, with it to first order in the residual.

    Args:
        cameras: the camera array, shape (view, COLUMNS).
        distorted: None if the rig has no lens with distortion polynomials.
        fisheye: None if it has no fisheye.
        points: shape (point, 3), in the world.
        pixels: shape (point, view, 2), NaN where missing.
        residuals: shape (point, view, 2), written: projected less observed, px; NaN where there is none.
        jacobians: shape (point, view, 2, 3), written: derivatives of the residuals, px per unit; NaN where there is
            none.
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
            rows_block(cameras, distorted, fisheye, v, block, codes, rows, scratch)
            for j in range(size):
                _store(rows, v, j, codes[v, j] == OK, points, first + j, residuals, jacobians)


@inline
def _store(rows, v, j, there, points, n, residuals, jacobians):
    depth, r, s = residual(rows, v, j, points[n, 0], points[n, 1], points[n, 2])
    there = there and depth > 0.0
    inverse = 1.0 / depth if there else math.nan
    residuals[n, v, 0] = r if there else math.nan
    residuals[n, v, 1] = s if there else math.nan
    for i in range(3):
        jacobians[n, v, 0, i] = (rows[v, i, j] - r * rows[v, 8 + i, j]) * inverse
        jacobians[n, v, 1, i] = (rows[v, 4 + i, j] - s * rows[v, 8 + i, j]) * inverse
