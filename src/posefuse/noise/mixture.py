"""Estimate the noise of inliers where some points have an outlier too small to be rejected.

Each point has either inliers only or exactly one outlier from an unknown distribution. Expectation maximization
estimates the noise of the inliers, the share of points with an outlier, and the distribution of outlier distances. See
docs/methods/noise.md.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.triangulation.linearized import LinearFit, multiply_2x2

_MAX_ROUNDS = 150
_TOLERANCE = 2e-4
_BINS = 20
# Outliers nearer than this many standard deviations act like inliers; none is farther than the second number.
_NEAREST, _FARTHEST = 2.75, 100.0
_MIN_INLIER_SHARE = 1e-3


@dataclass(frozen=True)
class Mixture:
    """A fitted mixture of inliers and outliers.

    Attributes:
        scale: standard deviation of inliers, in the units of the residuals.
        all_inliers: shape (point,): probability that all observations of the point are inliers.
        outlier: shape (point, view): probability that this observation is the point's outlier.
        distances: shape (bin,): distribution of outlier distances, on a logarithmic scale.
    """

    scale: float
    all_inliers: np.ndarray
    outlier: np.ndarray
    distances: np.ndarray


def fit_mixture(fit: LinearFit, start: Mixture | None = None) -> Mixture:
    """Fit the maximum-likelihood mixture of inliers and outliers.

    Args:
        fit: points with two views or more, with all used observations treated as inliers.
        start: the mixture of nearly the same fit, scaled to 1, to start from.
    """
    left_out, inverse = fit.leave_one_out()
    with np.errstate(divide="ignore"):
        distance = np.log(np.linalg.norm(left_out, axis=-1) / _NEAREST)
    # Decrease of a point's sum of squares if the view is left out.
    gain = (left_out * multiply_2x2(inverse, left_out)).sum(axis=-1)
    determinant = inverse[..., 0, 0] * inverse[..., 1, 1] - inverse[..., 0, 1] ** 2
    root = np.sqrt(np.maximum(determinant, 1e-9))
    views = fit.used.sum(axis=1)
    removable = fit.used & (views > 2)[:, None]
    squared, freedom = fit.squared, fit.degrees_of_freedom
    scale = 1.0 if start else 0.5 * float(np.sqrt(squared.sum() / freedom.sum()))
    inlier_share = float(start.all_inliers.mean()) if start else 0.8
    distances = start.distances if start else np.full(_BINS, 1.0 / _BINS)
    width = np.log(_FARTHEST / _NEAREST) / _BINS
    areas = np.pi * np.diff(np.exp(2.0 * width * np.arange(_BINS + 1))) * _NEAREST**2
    all_inliers = np.ones(len(views))
    point, view = np.nonzero(removable)
    distance, gain, root = (values[point, view] for values in (distance, gain, root))
    candidates, odds = np.zeros(0, dtype=int), np.zeros(0)
    for _ in range(_MAX_ROUNDS):
        place = (distance - np.log(scale)) / width
        # Most observations are so near that they can only be inliers.
        candidates = np.flatnonzero((place >= 0.0) & (place < _BINS))
        bins, of = place[candidates].astype(int), point[candidates]
        density = (distances / (areas * scale**2))[bins]
        # Likelihood ratio of an outlier to noise about the position that the other views predict.
        expected = root[candidates] / (2.0 * np.pi * scale**2) * np.exp(-0.5 * gain[candidates] / scale**2)
        odds = density / np.maximum(expected, 1e-300) * (1.0 - inlier_share) / (inlier_share * views[of])
        all_inliers = 1.0 / (1.0 + np.bincount(of, odds, len(views)))
        odds *= all_inliers[of]
        before = scale
        # Without its outlier a point's sum of squares is smaller by the gain, its degrees of freedom by two.
        left = squared.sum() - (odds * gain[candidates]).sum()
        scale = float(np.sqrt(left / (freedom.sum() - 2.0 * odds.sum())))
        inlier_share = min(max(float(all_inliers.mean()), _MIN_INLIER_SHARE), 1.0 - _MIN_INLIER_SHARE)
        distances = np.bincount(bins, odds, _BINS) + 1e-9
        distances /= distances.sum()
        if abs(scale - before) < _TOLERANCE * scale:
            break
    outlier = np.zeros(removable.shape)
    outlier[point[candidates], view[candidates]] = odds
    return Mixture(scale, all_inliers, outlier, distances)
