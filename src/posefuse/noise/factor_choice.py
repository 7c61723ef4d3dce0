"""Decide by the prediction of left-out views how far the noise of the cameras differs.

Every view of a point is predicted by the point's other views, once with equal noise in all cameras and once with a
noise for each camera. The logarithm of the predictive density, that of Student's t distribution, is compared point by
point. Errors of one keypoint are alike in all frames, because a detector places it consistently and a camera's error
lasts; the standard error of the comparison is therefore that of the means of keypoints (Liang & Zeger 1986).
"""

import numpy as np

from posefuse.noise.leave_one_out import LeaveOneOutPoints

_STRENGTHS = (0.5, 1.0)
"""Exponents of the factors to try, after 0, which is equal noise."""

_MIN_GAIN, _MIN_STANDARD_ERRORS = 0.01, 2.0
"""Least gain of the log density per coordinate, as from errors that are one percent smaller, and its significance."""

_NEAR = 25.0
"""Squared errors beyond this, in variances, with either noise, are those of rejected views and not predicted."""

_NU = 3.0
_ROUNDS = 50
_TOLERANCE = 1e-4
_MIN_DETERMINANT = 1e-6
_MIN_CLUSTERS = 12


def factors_by_prediction(found: LeaveOneOutPoints, factor: np.ndarray) -> np.ndarray:
    """Return the cameras' factors to a power of 0, 0.5 or 1, the strongest that predicts left-out views better.

    Args:
        found: points of a sample, triangulated with equal noise.
        factor: shape (view,): ratio of each camera's noise to the equal noise.
    """
    if np.ptp(factor) == 0.0:
        return factor
    predicted = found.used | _near(found, factor)
    best = np.ones(len(factor))
    score = _log_densities(found, predicted, best)
    for strength in _STRENGTHS:
        trial = factor**strength
        other = _log_densities(found, predicted, trial)
        if _is_better(other - score, _clusters(found)):
            best, score = trial, other
    return best


def _near(found: LeaveOneOutPoints, factor: np.ndarray) -> np.ndarray:
    """Return which observations are no gross errors at the points of the accepted views, with the cameras' noise."""
    fit = found.points.fit(found.sigma_px * factor, found.used)
    return np.isfinite(found.sigma_px) & (np.square(fit.residuals).sum(axis=-1) < _NEAR)


def _log_densities(found: LeaveOneOutPoints, predicted: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Return the mean log density of each point's views, per coordinate, shape (point,), NaN without predictions.

    Args:
        found: points of a sample.
        predicted: shape (point, view), bool: observations that predict each other.
        factor: shape (view,): the noise of the cameras; the scale that all of them share is estimated.
    """
    sigma = found.sigma_px * factor
    fit = found.points.fit(np.where(predicted, sigma, np.inf))
    residual, inverse = fit.leave_one_out()
    determinant = inverse[..., 0, 0] * inverse[..., 1, 1] - inverse[..., 0, 1] ** 2
    counts = fit.used & (fit.used.sum(axis=1) > 2)[:, None] & (determinant > _MIN_DETERMINANT)
    squared = np.einsum("pvi,pvij,pvj->pv", residual, inverse, residual)[counts]
    variance = _variance(squared)
    each = np.full(counts.shape, np.nan)
    each[counts] = 0.5 * np.log(determinant[counts]) - 2.0 * np.log(sigma[counts])
    each[counts] -= np.log(variance) + (0.5 * _NU + 1.0) * np.log1p(squared / (_NU * variance))
    n = counts.sum(axis=1)
    return np.where(n > 0, 0.5 * np.nansum(each, axis=1) / np.maximum(n, 1), np.nan)


def _variance(squared: np.ndarray) -> float:
    """Return the maximum-likelihood variance of squared errors in two dimensions under Student's t distribution."""
    if not squared.size:
        return 1.0
    variance = float(np.median(squared))
    for _ in range(_ROUNDS):
        before = variance
        variance = float((0.5 * (_NU + 2.0) * squared / (_NU + squared / variance)).mean())
        if abs(variance - before) <= _TOLERANCE * before:
            break
    return variance


def _clusters(found: LeaveOneOutPoints) -> np.ndarray:
    """Return the cluster of each point, shape (point,): its keypoint; of few keypoints, parts of the sample as well."""
    parts = -(-_MIN_CLUSTERS // max(len(np.unique(found.column)), 1))
    part = found.frame * parts // (found.frame.max() + 1)
    return found.column * parts + part


def _is_better(gain: np.ndarray, cluster: np.ndarray) -> bool:
    """Return whether a gain is relevant and significant.

    Args:
        gain: shape (point,): gain of the log density, NaN where nothing is predicted.
        cluster: shape (point,): points with the same number have similar errors.
    """
    known = np.isfinite(gain)
    if not known.any():
        return False
    mean = float(gain[known].mean())
    number = np.unique(cluster[known], return_inverse=True)[1]
    sums = np.bincount(number, gain[known] - mean)
    if len(sums) < 2:
        return False
    error = np.sqrt(len(sums) / (len(sums) - 1.0) * np.square(sums).sum()) / known.sum()
    return mean > max(_MIN_GAIN, _MIN_STANDARD_ERRORS * float(error))
