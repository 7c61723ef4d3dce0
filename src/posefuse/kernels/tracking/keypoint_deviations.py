"""Deviations of keypoints from fitted bodies, see :mod:`posefuse.pipeline.people.keypoint_deviations`."""

import math

import numpy as np

from posefuse.kernels.jit import kernel, subroutine
from posefuse.kernels.linear_algebra.principal_axes import diagonalize

_NU = 3.0
"""Degrees of freedom of the Student's t distribution of residuals."""


@kernel
def deviate(points, covariance, measured, noise, variance):
    """Add deviations to points of bodies, in place.

    Args:
        points: shape (n, 3): points of bodies, NaN where missing.
        covariance: shape (n, 6): their covariances, xx xy xz yy yz zz.
        measured: shape (n, 3): measured points, NaN where missing.
        noise: shape (n, 6): covariances of the measured points.
        variance: shape (n,): variances of the deviations, 0 for a rigid keypoint.
    """
    along, gains, kept, added = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    matrix, axes, own = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(points)):
        if not variance[n] > 0.0:
            continue
        if not _both_exist(points[n], measured[n], noise[n]):
            # The deviation is unknown.
            for i in (0, 3, 5):
                covariance[n, i] += variance[n]
            continue
        _unpack(noise[n], matrix)
        diagonalize(matrix, axes)
        squared = 0.0
        for i in range(3):
            matrix[i, i] = max(matrix[i, i], 0.0)
            along[i] = 0.0
            for j in range(3):
                along[i] += axes[j, i] * (measured[n, j] - points[n, j])
            squared += along[i] * along[i] / (matrix[i, i] + variance[n])
        weight = min((_NU + 3.0) / (_NU + squared), 1.0)
        for i in range(3):
            gain = weight * variance[n] / (matrix[i, i] + variance[n])
            gains[i] = gain
            kept[i] = math.sqrt(1.0 - gain * gain)
            added[i] = (1.0 - gain) * (1.0 - gain) * variance[n] + gain * gain * matrix[i, i]
        for i in range(3):
            for j in range(3):
                points[n, i] += axes[i, j] * gains[j] * along[j]
        _unpack(covariance[n], own)
        _pull_back(axes, kept, own, matrix)
        for i in range(3):
            matrix[i, i] += added[i]
        _pack_turned(axes, matrix, own, covariance[n])


@subroutine
def _both_exist(point, measured, noise):
    """Return whether a point of a body and a measured one with its covariance exist."""
    exist = math.isfinite(point[0]) and math.isfinite(measured[0])
    for i in range(6):
        exist = exist and math.isfinite(noise[i])
    return exist


@subroutine
def _unpack(packed, matrix):
    """Write six numbers xx xy xz yy yz zz as a symmetric matrix."""
    matrix[0, 0], matrix[1, 1], matrix[2, 2] = packed[0], packed[3], packed[5]
    matrix[0, 1], matrix[0, 2], matrix[1, 2] = packed[1], packed[2], packed[4]
    matrix[1, 0], matrix[2, 0], matrix[2, 1] = packed[1], packed[2], packed[4]


@subroutine
def _pull_back(axes, kept, own, out):
    """Write ``diag(kept) axes^T own axes diag(kept)``, a covariance in principal axes."""
    for i in range(3):
        for j in range(i, 3):
            value = 0.0
            for k in range(3):
                row = own[k, 0] * axes[0, j] + own[k, 1] * axes[1, j] + own[k, 2] * axes[2, j]
                value += axes[k, i] * row
            out[i, j] = kept[i] * value * kept[j]
            out[j, i] = out[i, j]


@subroutine
def _pack_turned(axes, matrix, scratch, packed):
    """Write the six numbers of ``axes matrix axes^T``."""
    for i in range(3):
        for j in range(3):
            scratch[i, j] = axes[i, 0] * matrix[0, j] + axes[i, 1] * matrix[1, j] + axes[i, 2] * matrix[2, j]
    place = 0
    for i in range(3):
        for j in range(i, 3):
            packed[place] = scratch[i, 0] * axes[j, 0] + scratch[i, 1] * axes[j, 1] + scratch[i, 2] * axes[j, 2]
            place += 1
