"""Sampson distances: how far the observations of two views are from their epipolar lines."""

import numpy as np

from posefuse.kernels.jit import kernel


@kernel
def sampson(at_a, sigma_a, at_b, sigma_b, essential):
    """Return squared Sampson distances in units of the noise variance.

    Args:
        at_a: shape (point, 2): x/z and y/z in the first view, NaN where missing.
        sigma_a: shape (point,): noise, as a length at depth 1.
        at_b: the same for the second view.
        sigma_b: the same for the second view.
        essential: shape (point, 3, 3), or (1, 3, 3) if it is constant: ``b^T E a = 0``.

    Returns:
        Shape (point,), NaN where a view does not observe the point.
    """
    distances = np.full(at_a.shape[0], np.nan)
    for i in range(at_a.shape[0]):
        e = essential[i if essential.shape[0] > 1 else 0]
        x, y, u, v = at_a[i, 0], at_a[i, 1], at_b[i, 0], at_b[i, 1]
        across_b = e[0, 0] * x + e[0, 1] * y + e[0, 2]
        down_b = e[1, 0] * x + e[1, 1] * y + e[1, 2]
        error = across_b * u + down_b * v + e[2, 0] * x + e[2, 1] * y + e[2, 2]
        across_a = e[0, 0] * u + e[1, 0] * v + e[2, 0]
        down_a = e[0, 1] * u + e[1, 1] * v + e[2, 1]
        variance = sigma_b[i] ** 2 * (across_b**2 + down_b**2) + sigma_a[i] ** 2 * (across_a**2 + down_a**2)
        if variance > 0.0:
            distances[i] = error * error / variance
    return distances
