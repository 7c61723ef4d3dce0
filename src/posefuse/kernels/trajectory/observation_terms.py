"""Terms of views and smoothness in the trajectory system, for all keypoint paths.

The first axis is the keypoint, the second the frame. The band has the layout of
:mod:`posefuse.kernels.trajectory.band`.
"""

import math
from typing import Any, NamedTuple

from posefuse.kernels.jit import inline, kernel, vectorized
from posefuse.kernels.trajectory.band import REACH

_MAX_PATH_VARIANCE = 10.0
"""Upper bound of the path's own variance in the weights, in units of the variance of a detection."""


class ViewTerms(NamedTuple):
    """Linearized observations of all views.

    Attributes:
        residuals: shape (keypoint, frame, view, 2).
        jacobians: shape (keypoint, frame, view, 2, 3).
        sigma: shape (keypoint, frame, view).
        weights: shape (keypoint, frame, view).
    """

    residuals: Any
    jacobians: Any
    sigma: Any
    weights: Any


class SmoothnessTerms(NamedTuple):
    """Smoothness prior of all paths.

    Attributes:
        differences: shape (row, REACH + 1).
        stiffness: shape (keypoint, row).
        ridge: shape (keypoint,): small information that ties each point to its current position.
    """

    differences: Any
    stiffness: Any
    ridge: Any


class PathSystem(NamedTuple):
    """Normal equations of all paths.

    Attributes:
        band: shape (keypoint, frame, REACH + 1, 3, 3).
        rhs: shape (keypoint, frame, 3): negative gradient.
        information: shape (keypoint, frame, 3, 3): of single frames.
    """

    band: Any
    rhs: Any
    information: Any


@kernel
def weigh_observations(residuals, jacobians, sigma, covariance, full, none, weights):
    """Compute weights of observations from their distance to the path: 1 up to ``full`` sigmas, 0 from ``none`` on.

    The covariance of the path, projected into the view, is added to that of the detection up to a bound. Beyond the
    bound an undetermined path could not separate inliers from outliers.

    Args:
        residuals: shape (point, view, 2), px, NaN where missing.
        jacobians: shape (point, view, 2, 3).
        sigma: shape (point, view), px, inf where an observation does not count.
        covariance: shape (point, 3, 3).
        full: in sigmas.
        none: in sigmas.
        weights: shape (point, view), written.
    """
    full_squared = full * full
    slope = 1.0 / (none * none - full_squared)
    for n in range(residuals.shape[0]):
        for v in range(residuals.shape[1]):
            s = sigma[n, v]
            x = residuals[n, v, 0]
            y = residuals[n, v, 1]
            a = _quadratic_form(jacobians[n, v, 0], covariance[n], jacobians[n, v, 0])
            b = _quadratic_form(jacobians[n, v, 0], covariance[n], jacobians[n, v, 1])
            c = _quadratic_form(jacobians[n, v, 1], covariance[n], jacobians[n, v, 1])
            bound = _MAX_PATH_VARIANCE * s * s
            scale = bound / (a + c) if a + c > bound else 1.0
            a = scale * a + s * s
            b = scale * b
            c = scale * c + s * s
            squared = (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)
            weight = min(1.0 - (squared - full_squared) * slope, 1.0)
            # Comparisons with NaN are false, so missing observations get weight 0.
            weights[n, v] = weight if weight > 0.0 and s < math.inf else 0.0


@inline
def _quadratic_form(first, matrix, second):
    """Return ``first^T matrix second``."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += first[i] * matrix[i, j] * second[j]
    return total


@kernel
def whiten_errors(residuals, sigma, used, correlation, squares, counts):
    """Compute squared innovations of errors: the part that does not follow from the last observed error, in sigmas.

    Args:
        residuals: shape (keypoint, frame, view, 2), px.
        sigma: shape (keypoint, frame, view), px.
        used: shape (keypoint, frame, view): positive where an error counts.
        correlation: shape (frame,): correlation of an error with that of the previous frame.
        squares: shape (keypoint, frame, view), written: sum over both axes, in units of the expected variance; 0 if
            unused.
        counts: the same shape, written: number of values in the sum, 2 or 0.
    """
    for k in range(residuals.shape[0]):
        for v in range(residuals.shape[2]):
            last = -1
            lag_correlation = 1.0
            for f in range(residuals.shape[1]):
                lag_correlation *= correlation[f]
                squares[k, f, v] = 0.0
                counts[k, f, v] = 0.0
                if not used[k, f, v] > 0.0:
                    continue
                x = residuals[k, f, v, 0] / sigma[k, f, v]
                y = residuals[k, f, v, 1] / sigma[k, f, v]
                c = 0.0
                if last >= 0 and f - last <= REACH:
                    c = lag_correlation
                    x -= c * residuals[k, last, v, 0] / sigma[k, last, v]
                    y -= c * residuals[k, last, v, 1] / sigma[k, last, v]
                squares[k, f, v] = (x * x + y * y) / (1.0 - c * c)
                counts[k, f, v] = 2.0
                last = f
                lag_correlation = 1.0


@vectorized
def add_view(views, k, v, system):
    """Add the observations of a keypoint in one view.

    Args:
        views: ViewTerms.
        k: the keypoint.
        v: the view.
        system: PathSystem, added to.
    """
    residuals, jacobians, sigma, weights = views.residuals[k], views.jacobians[k], views.sigma[k], views.weights[k]
    rhs, information = system.rhs[k], system.information[k]
    for f in range(residuals.shape[0]):
        weight = weights[f, v]
        if not weight > 0.0:
            continue
        factor = weight / (sigma[f, v] * sigma[f, v])
        x = residuals[f, v, 0]
        y = residuals[f, v, 1]
        first = jacobians[f, v, 0]
        second = jacobians[f, v, 1]
        for i in range(3):
            rhs[f, i] -= factor * (first[i] * x + second[i] * y)
            for j in range(3):
                information[f, i, j] += factor * (first[i] * first[j] + second[i] * second[j])


@vectorized
def add_smoothness(differences, stiffness, path, band, rhs):
    """Add the prior that finite differences over neighboring frames are small.

    Args:
        differences: shape (row, REACH + 1): coefficients of frames ``row`` to ``row + REACH``; the last may be 0 with
            the frame missing.
        stiffness: shape (row,): inverse variance of the result of the row.
        path: shape (frame, 3).
        band: shape (frame, REACH + 1, 3, 3), added to.
        rhs: shape (frame, 3), added to.
    """
    frames = path.shape[0]
    for row in range(differences.shape[0]):
        w = stiffness[row]
        if w == 0.0:
            continue
        reach = min(REACH, frames - 1 - row)
        c = differences[row]
        for i in range(3):
            residual = 0.0
            for a in range(reach + 1):
                residual += c[a] * path[row + a, i]
            for a in range(reach + 1):
                rhs[row + a, i] -= w * c[a] * residual
        for a in range(reach + 1):
            for b in range(a + 1):
                value = w * c[a] * c[b]
                for i in range(3):
                    band[row + a, a - b, i, i] += value


@kernel
def assemble_system(views, smoothness, paths, system):
    """Assemble the terms of views and smoothness for all keypoints.

    Args:
        views: ViewTerms.
        smoothness: SmoothnessTerms.
        paths: shape (keypoint, frame, 3).
        system: PathSystem, written.
    """
    differences, stiffness, ridge = smoothness
    band, rhs, information = system
    for k in range(paths.shape[0]):
        band[k] = 0.0
        rhs[k] = 0.0
        information[k] = 0.0
        for v in range(views.residuals.shape[2]):
            add_view(views, k, v, system)
        for f in range(paths.shape[1]):
            for i in range(3):
                for j in range(3):
                    band[k, f, 0, i, j] = information[k, f, i, j]
                band[k, f, 0, i, i] += ridge[k]
        add_smoothness(differences, stiffness[k], paths[k], band[k], rhs[k])


@kernel
def squared_differences(differences, stiffness, paths, covariance, squares, determined):
    """Compute squared finite differences of the paths, and how many of their components the data determine.

    Args:
        differences: shape (row, REACH + 1).
        stiffness: shape (keypoint, row): inverse of the expected variance of a row.
        paths: shape (keypoint, frame, 3).
        covariance: shape (keypoint, frame, REACH + 1, 3, 3), within the band.
        squares: shape (keypoint, row), written: squared difference in units of the expected variance.
        determined: shape (keypoint, row), written: number of the 3 components that the data determine.
    """
    frames = paths.shape[1]
    for k in range(paths.shape[0]):
        for row in range(differences.shape[0]):
            w = stiffness[k, row]
            reach = min(REACH, frames - 1 - row)
            squared = 0.0
            for i in range(3):
                residual = 0.0
                for a in range(reach + 1):
                    residual += differences[row, a] * paths[k, row + a, i]
                squared += residual * residual
            predicted_variance = 0.0
            for a in range(reach + 1):
                for b in range(a + 1):
                    z = covariance[k, row + a, a - b]
                    trace = z[0, 0] + z[1, 1] + z[2, 2]
                    predicted_variance += (1.0 if a == b else 2.0) * differences[row, a] * differences[row, b] * trace
            squares[k, row] = w * squared
            determined[k, row] = min(max(3.0 - w * predicted_variance, 0.0), 3.0) if w > 0.0 else 0.0
