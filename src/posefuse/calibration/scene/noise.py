"""Errors of measured places of points of known position, from the residuals of all cameras."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.calibration.scene.view import STUDENT_T_DOF, SceneView

_CLICK_PX = 1.0
"""Expected error of a place that was measured in an image."""
_EXPECTED_COUNT = 4.0
"""Number of observations by which the expected error counts."""
_POSE = 6


@dataclass(frozen=True)
class PlaceNoise:
    """Errors of measured places, per coordinate.

    Attributes:
        scale_px: scale of the Student-t distribution that weights the places.
        sd_px: standard deviation of a place under which an estimate with equal weights would have the covariance of the
            weighted one.
    """

    scale_px: float
    sd_px: float


def place_noise(views: Sequence[SceneView], scale_px: float) -> PlaceNoise:
    """Return the errors of places from the residuals of all cameras.

    The standard deviation follows from the asymptotic covariance of M-estimates: the mean squared influence of an error
    over the square of its mean derivative (Huber 1964, Robust Estimation of a Location Parameter).

    Args:
        views: the cameras at their estimated poses.
        scale_px: scale by which the places were weighted.
    """
    weighted = influence = 0.0
    n_free, slopes = 0, []
    for view in views:
        squared = view.rows()[0] ** 2
        free = max(squared.size - _POSE, 1)
        # A pose fits the places, so their errors are larger than the residuals.
        relative = squared * (squared.size / free) / scale_px**2
        below = STUDENT_T_DOF + relative.sum(axis=1, keepdims=True)
        weight = (STUDENT_T_DOF + 2.0) / below
        weighted += float((weight * squared).sum())
        influence += float((weight**2 * squared).sum())
        slopes.append((weight * (1.0 - 2.0 * relative / below)).ravel())
        n_free += free
    slope = np.concatenate(slopes)
    # With few places, the weights fit them, too (Huber 1973, Robust Regression, equation 6.10).
    fitted = 1.0 + _POSE * len(views) / slope.size * float(np.var(slope) / np.mean(slope) ** 2)
    efficient = influence * (fitted / float(np.mean(slope))) ** 2
    expected, count = _EXPECTED_COUNT * _CLICK_PX**2, _EXPECTED_COUNT + n_free
    return PlaceNoise(float(np.sqrt((expected + weighted) / count)), float(np.sqrt((expected + efficient) / count)))
