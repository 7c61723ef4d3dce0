"""Estimate how much larger the errors of each camera are than those of the other cameras, systematic errors included.

A camera's pose, clock or lens that is slightly wrong shifts its rays; all points of a frame share the shift, so that it
does not average out. A detector can also place a keypoint differently in each view. The estimate is that of variance
components: the residuals of a joint fit understate the errors of a camera by the share of the fit that it determines
(Patterson & Thompson 1971), and heavy tails are those of a Student t distribution (Lange, Little & Taylor 1989). See
docs/methods/noise.md.
"""

import numpy as np

from posefuse.triangulation.linearized import LinearPoints

_MIN_VIEWS = 3
_MIN_POINTS = 30
_NU = 3.0
_ROUNDS = 60
_TOLERANCE = 1e-2
_STEP = 1.6
"""Multiple of the logarithmic step of the estimate that is taken; a multiple below 2 converges, too, and faster."""

_FEW_POINTS = 600
_PRIOR_SHARE = 0.1
"""Weight of the prior, cameras that are alike, as a share of the recording's evidence. Residuals of three views allow
that one camera is without error, and that camera would then determine every point alone."""

_GROSS, _NO_WEIGHT = 25.0, 1e-6
"""Squared errors beyond the first number, in variances, are those of other points, of swapped labels or of views that
belong elsewhere. The method ``consensus`` rejects views beyond the same number."""

_START = 9.0
"""Variance to start with, above that of slightly wrong cameras in three views, so that their errors are not gross."""

_MIN_NEAR_SHARE = 0.6
"""A camera with fewer observations that are no gross errors shows something else, and its factor means nothing."""

_CHANCE = 0.15
"""Largest logarithm of a factor that counts as chance."""

_MIN_FACTOR = 0.1


def camera_factors(points: LinearPoints, sigma_px: np.ndarray) -> np.ndarray:
    """Return the ratio of each camera's errors to the assumed noise, relative to the other cameras, shape (view,).

    A camera of which most observations are gross errors has the factor inf.

    Args:
        points: observations, linearized at the triangulated points.
        sigma_px: shape (point, view): assumed standard deviation of each observation; inf where there is none.

    Returns:
        The factors; their median is 1. All are 1 with too few points in three views, if all errors are gross, or if the
        cameras differ hardly more than by chance.
    """
    seen = np.isfinite(sigma_px) & np.isfinite(points.residuals_px[..., 0])
    informative = seen.sum(axis=1) >= _MIN_VIEWS
    n = (seen & informative[:, None]).sum(axis=0)
    if n.min() < _MIN_POINTS:
        return np.ones(len(n))
    rows = np.flatnonzero(informative)
    sigma_px = np.where(seen, sigma_px, np.inf)
    variance = np.full(len(n), _START)
    # Few points give a start; the differences between samples of this size would be as large as some factors.
    for part in (rows[np.random.default_rng(0).permutation(len(rows))[:_FEW_POINTS]], rows):
        part_points = LinearPoints(points.residuals_px[part], points.jacobians[part])
        variance, near = _variances(part_points, sigma_px[part], variance)
    logs = 0.5 * np.log(variance)
    logs -= np.median(logs)
    gross = near < _MIN_NEAR_SHARE * seen[rows].sum(axis=0)
    if gross.all():
        return np.ones(len(n))
    logs = np.where(gross, np.inf, logs)
    if np.abs(logs).max() < _CHANCE:
        return np.ones(len(n))
    return np.maximum(np.exp(logs), _MIN_FACTOR)


def _variances(points: LinearPoints, sigma_px: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the variance of each camera's errors, and the number of observations that are no gross errors.

    Args:
        points: points in three views or more.
        sigma_px: shape (point, view): assumed standard deviation of each observation; inf where there is none.
        variance: shape (view,): variances to start with, in units of the assumed ones.
    """
    seen = np.isfinite(sigma_px)
    weight, n = np.ones(seen.shape), seen.sum(axis=0)
    for _ in range(_ROUNDS):
        fit = points.fit(sigma_px * np.sqrt(variance / weight))
        # Expected squared error: the residual of the fit, and the part of the error that the fit absorbed.
        squared = fit.squares + fit.leverages
        squared = np.where(seen, squared / weight, 0.0)
        near = seen & (squared < _GROSS)
        weight = np.where(near, (_NU + 2.0) / (_NU + squared), _NO_WEIGHT)
        n = near.sum(axis=0)
        if not n.any():
            break
        found = variance * np.where(near, weight * squared, 0.0).sum(axis=0) / np.maximum(2.0 * n, 1.0)
        found = np.where(n < _MIN_POINTS, variance, found)
        common = np.median(found)
        before = variance
        variance = (n * found + _PRIOR_SHARE * n.mean() * common) / (n + _PRIOR_SHARE * n.mean())
        if np.abs(np.log(variance / before)).max() < _TOLERANCE:
            break
        variance = before * (variance / before) ** _STEP
    return variance, n
