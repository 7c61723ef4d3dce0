"""Cubic splines as OpenSim's SimmSpline interpolates them."""

import numpy as np


def simm_spline(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the pieces of a cubic spline, shape (knot, 4), lowest power of the distance to the knot first.

    The third derivatives at the ends are those of the cubics through the four outermost points (Forsythe, Malcolm and
    Moler 1977, Computer Methods for Mathematical Computations, section 4.4). Beyond the ends the spline is linear.

    Args:
        x: shape (knot,), increasing; at least four knots.
        y: shape (knot,): values.
    """
    n = len(x)
    d = np.diff(x)
    slopes = np.diff(y) / d
    # Unknowns are the second derivatives at the knots divided by six.
    matrix, right = np.zeros((n, n)), np.zeros(n)
    for i in range(1, n - 1):
        matrix[i, i - 1 : i + 2] = d[i - 1], 2.0 * (d[i - 1] + d[i]), d[i]
        right[i] = slopes[i] - slopes[i - 1]
    matrix[0, :2] = -d[0], d[0]
    matrix[-1, -2:] = d[-1], -d[-1]
    right[0] = d[0] ** 2 * _third_difference(x[:4], y[:4])
    right[-1] = -(d[-1] ** 2) * _third_difference(x[-4:], y[-4:])
    c = np.linalg.solve(matrix, right)
    pieces = np.zeros((n, 4))
    pieces[:, 0] = y
    pieces[:-1, 1] = slopes - d * (c[1:] + 2.0 * c[:-1])
    pieces[-1, 1] = slopes[-1] + d[-1] * (c[-2] + 2.0 * c[-1])
    pieces[:, 2] = 3.0 * c
    pieces[:-1, 3] = np.diff(c) / d
    pieces[-1, 2:] = 0.0
    return pieces


def _third_difference(x: np.ndarray, y: np.ndarray) -> float:
    """Return the third divided difference of four points."""
    first = np.diff(y) / np.diff(x)
    second = np.diff(first) / (x[2:] - x[:-2])
    return float((second[1] - second[0]) / (x[3] - x[0]))
