"""Linearized reprojection: residuals and their derivatives at given points."""

import math

import numpy as np

from posefuse.kernels.cameras.lens import OK
from posefuse.kernels.cameras.observation_rows import BLOCK, residual, rows_block
from posefuse.kernels.jit import inline, kernel

LINEAR_ROWS = 8
"""Rows of a linearized observation: two residuals in px, projected minus observed, and the derivatives of each with
respect to the point."""


@kernel
def linearize_paths(cameras, paths, pixels, linear):
    """Linearize the observations of all paths.

    Residuals are those of the observation rows: exact without distortion, and first order in the residual with it.

    Args:
        cameras: the camera array.
        paths: shape (keypoint, frame, 3).
        pixels: shape (keypoint, frame, view, 2), NaN where missing.
        linear: shape (keypoint, block, view, LINEAR_ROWS * BLOCK), written: NaN residuals and derivatives of 0 where
            undefined. Frame ``f`` is in block ``f // BLOCK``, and row ``i`` at ``i * BLOCK + f % BLOCK``.
    """
    n_views = cameras.shape[0]
    block = np.empty((n_views, 2, BLOCK))
    codes = np.empty((n_views, BLOCK), np.int64)
    rows = np.empty((n_views, 12, BLOCK))
    scratch = np.empty((6, BLOCK))
    point = np.empty((3, BLOCK))
    frames = paths.shape[1]
    for k in range(paths.shape[0]):
        for b in range(linear.shape[1]):
            for j in range(BLOCK):
                f = min(b * BLOCK + j, frames - 1)
                for i in range(3):
                    point[i, j] = paths[k, f, i]
                for v in range(n_views):
                    block[v, 0, j] = pixels[k, f, v, 0]
                    block[v, 1, j] = pixels[k, f, v, 1]
            for v in range(n_views):
                rows_block(cameras, v, block, codes, rows, scratch)
                _store_linear(rows, codes, v, point, linear[k, b, v])


@inline
def _store_linear(rows, codes, v, point, out):
    """Write the residuals of a block in one view, and their derivatives."""
    for j in range(BLOCK):
        depth, r, s = residual(rows, v, j, point[0, j], point[1, j], point[2, j])
        valid = (codes[v, j] == OK) & (depth > 0.0)
        inverse = 1.0 / depth
        out[j] = r if valid else math.nan
        out[BLOCK + j] = s if valid else math.nan
        for i in range(3):
            out[(2 + i) * BLOCK + j] = (rows[v, i, j] - r * rows[v, 8 + i, j]) * inverse if valid else 0.0
            out[(5 + i) * BLOCK + j] = (rows[v, 4 + i, j] - s * rows[v, 8 + i, j]) * inverse if valid else 0.0


@kernel
def linearize_views(cameras, paths, pixels, residuals, jacobians):
    """Linearize the observations of all paths, see :func:`linearize`.

    Args:
        cameras: the camera array.
        paths: shape (keypoint, frame, 3).
        pixels: shape (keypoint, frame, view, 2), NaN where missing.
        residuals: shape (keypoint, frame, view, 2), px, written.
        jacobians: shape (keypoint, frame, view, 2, 3), written; shape (0, frame, view, 2, 3) to write residuals only.
    """
    n_views = cameras.shape[0]
    block = np.empty((n_views, 2, BLOCK))
    codes = np.empty((n_views, BLOCK), np.int64)
    rows = np.empty((n_views, 12, BLOCK))
    scratch = np.empty((6, BLOCK))
    point = np.empty((3, BLOCK))
    linear = np.empty(LINEAR_ROWS * BLOCK)
    frames = paths.shape[1]
    for k in range(paths.shape[0]):
        for first in range(0, frames, BLOCK):
            for j in range(BLOCK):
                f = min(first + j, frames - 1)
                for i in range(3):
                    point[i, j] = paths[k, f, i]
                for v in range(n_views):
                    block[v, 0, j] = pixels[k, f, v, 0]
                    block[v, 1, j] = pixels[k, f, v, 1]
            for v in range(n_views):
                rows_block(cameras, v, block, codes, rows, scratch)
                _store_linear(rows, codes, v, point, linear)
                for j in range(min(BLOCK, frames - first)):
                    f = first + j
                    residuals[k, f, v, 0] = linear[j]
                    residuals[k, f, v, 1] = linear[BLOCK + j]
                    if jacobians.shape[0] > 0:
                        valid = linear[j] == linear[j]
                        for i in range(3):
                            jacobians[k, f, v, 0, i] = linear[(2 + i) * BLOCK + j] if valid else math.nan
                            jacobians[k, f, v, 1, i] = linear[(5 + i) * BLOCK + j] if valid else math.nan


def linearize(cameras: np.ndarray, paths: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return residuals (keypoint, frame, view, 2) in px, and their derivatives (..., 2, 3); NaN where undefined.

    Args:
        cameras: the camera array.
        paths: shape (keypoint, frame, 3).
        pixels: shape (keypoint, frame, view, 2), NaN where missing.
    """
    residuals, jacobians = np.empty(pixels.shape), np.empty((*pixels.shape, 3))
    linearize_views(cameras, paths, pixels, residuals, jacobians)
    return residuals, jacobians


def residuals_px(cameras: np.ndarray, paths: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return the residuals that :func:`linearize` returns, which take a fraction of the memory of the derivatives."""
    residuals = np.empty(pixels.shape)
    linearize_views(cameras, paths, pixels, residuals, np.empty((0, *pixels.shape[1:], 3)))
    return residuals
