"""Terms of views and smoothness in the trajectory system, for all keypoint paths.

Arrays of numbers per keypoint and frame are in blocks, see :mod:`posefuse.kernels.trajectory.blocks`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.jit import inline, kernel
from posefuse.kernels.trajectory.band import REACH

_MAX_PATH_VARIANCE = 10.0
"""Upper bound of the path's own variance in the weights, in units of the variance of a detection."""

_USED = 0.5
"""Minimum weight of an observation that counts."""


class ViewTerms(NamedTuple):
    """Linearized observations of all views.

    Attributes:
        linear: shape (keypoint, block, view, LINEAR_ROWS * BLOCK): NaN residuals and derivatives of 0 where undefined.
        sigma: shape (keypoint, frame, view), px: inf where an observation does not count.
        scale: shape (keypoint, frame, view): factor of sigma.
        level: shape (keypoint,): factor of sigma.
        weights: shape (keypoint, frame, view): set to 0 where an observation is undefined.
    """

    linear: Any
    sigma: Any
    scale: Any
    level: Any
    weights: Any


class PathSystem(NamedTuple):
    """Normal equations of all paths.

    Attributes:
        diagonal: shape (keypoint, block, 6 * BLOCK): matrix of each frame.
        coupling: shape (keypoint, block, REACH * BLOCK): multiple of the identity that couples each frame with the one,
            two and three before; 0 where there is none.
        rhs: shape (keypoint, block, 3 * BLOCK): negative gradient.
        information: shape (keypoint, block, 6 * BLOCK): that of the views in each frame.
    """

    diagonal: Any
    coupling: Any
    rhs: Any
    information: Any


@kernel
def weigh_observations(linear, sigma, covariance, full, none, weights, counts):
    """Compute weights of observations from their distance to the path: 1 up to ``full`` sigmas, 0 from ``none`` on.

    The covariance of the path, projected into the view, is added to that of the detection up to a bound. Beyond the
    bound an undetermined path could not separate inliers from outliers.

    Args:
        linear: from :func:`posefuse.kernels.cameras.linearize.linearize_paths`.
        sigma: shape (keypoint, frame, view), px, inf where an observation does not count.
        covariance: shape (keypoint, frame, 3, 3).
        full: in sigmas.
        none: in sigmas.
        weights: shape (keypoint, frame, view), written.
        counts: shape (keypoint, frame), int64, written: number of views that count.
    """
    block = np.empty((8, BLOCK))
    full_squared = full * full
    slope = 1.0 / (none * none - full_squared)
    frames = sigma.shape[1]
    for k in range(linear.shape[0]):
        for b in range(linear.shape[1]):
            first = b * BLOCK
            end = min(BLOCK, frames - first)
            for j in range(BLOCK):
                f = first + min(j, end - 1)
                for i in range(3):
                    block[i, j] = covariance[k, f, 0, i]
                block[3, j] = covariance[k, f, 1, 1]
                block[4, j] = covariance[k, f, 1, 2]
                block[5, j] = covariance[k, f, 2, 2]
            for j in range(end):
                counts[k, first + j] = 0
            for v in range(linear.shape[2]):
                for j in range(BLOCK):
                    block[6, j] = sigma[k, first + min(j, end - 1), v]
                _weigh_block(linear[k, b, v], block, full_squared, slope)
                for j in range(end):
                    weights[k, first + j, v] = block[7, j]
                    counts[k, first + j] += 1 if block[7, j] > _USED else 0


@inline
def _weigh_block(own, block, full_squared, slope):
    """Compute the weights of a block in one view; ``block`` has rows of covariance, sigma, and the weight."""
    for j in range(BLOCK):
        s = block[6, j]
        x = own[j]
        y = own[BLOCK + j]
        xx = block[0, j]
        xy = block[1, j]
        xz = block[2, j]
        yy = block[3, j]
        yz = block[4, j]
        zz = block[5, j]
        g0 = own[2 * BLOCK + j]
        g1 = own[3 * BLOCK + j]
        g2 = own[4 * BLOCK + j]
        h0 = own[5 * BLOCK + j]
        h1 = own[6 * BLOCK + j]
        h2 = own[7 * BLOCK + j]
        p0 = xx * g0 + xy * g1 + xz * g2
        p1 = xy * g0 + yy * g1 + yz * g2
        p2 = xz * g0 + yz * g1 + zz * g2
        a = g0 * p0 + g1 * p1 + g2 * p2
        b = h0 * p0 + h1 * p1 + h2 * p2
        c = h0 * (xx * h0 + xy * h1 + xz * h2) + h1 * (xy * h0 + yy * h1 + yz * h2)
        c += h2 * (xz * h0 + yz * h1 + zz * h2)
        bound = _MAX_PATH_VARIANCE * s * s
        scale = bound / (a + c) if a + c > bound else 1.0
        a = scale * a + s * s
        b = scale * b
        c = scale * c + s * s
        squared = (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)
        weight = min(1.0 - (squared - full_squared) * slope, 1.0)
        # Comparisons with NaN are false, so missing observations get weight 0.
        block[7, j] = weight if (weight > 0.0) & (s < math.inf) else 0.0


@kernel
def scale_residuals(sigma, agreed, residuals, left):
    """Scale residuals at measured points to errors in sigmas: a point absorbs three of the numbers that determine it.

    Args:
        sigma: shape (keypoint, frame, view), px, inf where an observation does not count.
        agreed: the same shape, bool: whether the measured point uses the observation.
        residuals: shape (keypoint, frame, view, 2): in px, NaN where undefined; overwritten, 0 where not used.
        left: shape (keypoint, frame, view), written: fraction of the variance that residuals retain; 0 if not used.
    """
    n_views = sigma.shape[2]
    for k in range(sigma.shape[0]):
        for f in range(sigma.shape[1]):
            count = 0
            for v in range(n_views):
                used = agreed[k, f, v] & (sigma[k, f, v] < math.inf) & math.isfinite(residuals[k, f, v, 0])
                left[k, f, v] = 1.0 if used else 0.0
                count += 1 if used else 0
            retained = max(2.0 * count - 3.0, 1.0) / max(2.0 * count, 1.0)
            root = math.sqrt(retained)
            for v in range(n_views):
                used = (count > 1) & (left[k, f, v] > 0.0)
                left[k, f, v] = retained if used else 0.0
                for i in range(2):
                    residuals[k, f, v, i] = residuals[k, f, v, i] / sigma[k, f, v] / root if used else 0.0


@inline
def _add_innovations(first, residuals, retained, correlations, backward, squares):
    """Add the squared innovations of the views of one keypoint in one direction of time.

    Args:
        first: shape (2, view): the last frame with an error, or -1, and the correlation since; overwritten.
        residuals: shape (frame, view, 2), in sigmas of the noise model.
        retained: shape (frame, view): positive where an error counts.
        correlations: shape (frame + 1,): correlation of the error of each frame with that of the frame before; 0 at
            both ends.
        backward: whether time runs backward.
        squares: shape (frame, view), added to.
    """
    frames = residuals.shape[0]
    for v in range(residuals.shape[1]):
        first[0, v] = -1.0
        first[1, v] = 1.0
    for n in range(frames):
        f = frames - 1 - n if backward else n
        correlation = correlations[f + 1] if backward else correlations[f]
        for v in range(residuals.shape[1]):
            lag_correlation = first[1, v] * correlation
            first[1, v] = lag_correlation
            if retained[f, v] > 0.0:
                last = int(first[0, v])
                x = residuals[f, v, 0]
                y = residuals[f, v, 1]
                c = lag_correlation if last >= 0 and abs(f - last) <= REACH else 0.0
                if c != 0.0:
                    x -= c * residuals[last, v, 0]
                    y -= c * residuals[last, v, 1]
                squares[f, v] += (x * x + y * y) / (1.0 - c * c)
                first[0, v] = f
                first[1, v] = 1.0


@kernel
def whiten_errors(residuals, retained, correlations, variance, squares):
    """Compute squared innovations of errors: the part that does not follow from the last observed error.

    An innovation belongs to the later frame. The mean over both directions of time prefers neither.

    Args:
        residuals: shape (keypoint, frame, view, 2), in sigmas of the noise model.
        retained: shape (keypoint, frame, view): weight of the innovations; 0 where an error does not count.
        correlations: shape (frame + 1,): correlation of the error of each frame with that of the frame before; 0 at
            both ends.
        variance: of the errors, relative to the noise model.
        squares: shape (keypoint, frame, view), written: weighted sum over both axes, in units of the expected variance.
    """
    first = np.empty((2, residuals.shape[2]))
    for k in range(residuals.shape[0]):
        squares[k] = 0.0
        _add_innovations(first, residuals[k], retained[k], correlations, False, squares[k])
        _add_innovations(first, residuals[k], retained[k], correlations, True, squares[k])
        for f in range(residuals.shape[1]):
            for v in range(residuals.shape[2]):
                squares[k, f, v] *= 0.5 * retained[k, f, v] / variance


@kernel
def add_views(views, system, seen):
    """Sum the observations of all views.

    Args:
        views: ViewTerms.
        system: PathSystem; its information and right-hand side are written.
        seen: shape (keypoint, frame), bool, written: whether any view counts.
    """
    linear, sigma, scale, level, weights = views
    information, rhs = system.information, system.rhs
    factor = np.empty(BLOCK)
    sums = np.empty((9, BLOCK))
    frames = weights.shape[1]
    for k in range(linear.shape[0]):
        for b in range(linear.shape[1]):
            first = b * BLOCK
            end = min(BLOCK, frames - first)
            for i in range(9):
                for j in range(BLOCK):
                    sums[i, j] = 0.0
            for j in range(end):
                seen[k, first + j] = False
            for v in range(linear.shape[2]):
                own = linear[k, b, v]
                for j in range(end):
                    f = first + j
                    weight = weights[k, f, v] if own[j] == own[j] else 0.0
                    s = level[k] * sigma[k, f, v] * scale[k, f, v]
                    factor[j] = weight / (s * s) if weight > 0.0 else 0.0
                    weights[k, f, v] = weight
                    seen[k, f] |= weight != 0.0
                for j in range(end, BLOCK):
                    factor[j] = 0.0
                _add_block(own, factor, sums)
            _store_sums(sums, information[k, b], rhs[k, b])


@inline
def _store_sums(sums, information, rhs):
    """Write the information of a block and the negative gradient."""
    for i in range(6):
        for j in range(BLOCK):
            information[i * BLOCK + j] = sums[i, j]
    for i in range(3):
        for j in range(BLOCK):
            rhs[i * BLOCK + j] = -sums[6 + i, j]


@inline
def _add_block(own, factor, sums):
    """Add the observations of a block in one view to the information and the gradient."""
    for j in range(BLOCK):
        w = factor[j]
        x = own[j] if w > 0.0 else 0.0
        y = own[BLOCK + j] if w > 0.0 else 0.0
        g0 = w * own[2 * BLOCK + j]
        g1 = w * own[3 * BLOCK + j]
        g2 = w * own[4 * BLOCK + j]
        h0 = w * own[5 * BLOCK + j]
        h1 = w * own[6 * BLOCK + j]
        h2 = w * own[7 * BLOCK + j]
        sums[0, j] += g0 * own[2 * BLOCK + j] + h0 * own[5 * BLOCK + j]
        sums[1, j] += g0 * own[3 * BLOCK + j] + h0 * own[6 * BLOCK + j]
        sums[2, j] += g0 * own[4 * BLOCK + j] + h0 * own[7 * BLOCK + j]
        sums[3, j] += g1 * own[3 * BLOCK + j] + h1 * own[6 * BLOCK + j]
        sums[4, j] += g1 * own[4 * BLOCK + j] + h1 * own[7 * BLOCK + j]
        sums[5, j] += g2 * own[4 * BLOCK + j] + h2 * own[7 * BLOCK + j]
        sums[6, j] += g0 * x + h0 * y
        sums[7, j] += g1 * x + h1 * y
        sums[8, j] += g2 * x + h2 * y
