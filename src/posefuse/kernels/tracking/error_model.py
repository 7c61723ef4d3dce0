"""Error model of detections: the variance of a keypoint from its confidence and its view."""

from collections import namedtuple

from posefuse.kernels.jit import inline
from posefuse.kernels.tracking.point_projection import squared_px_per_m

ErrorModel = namedtuple("ErrorModel", "scale_px exponent floor_m nu gate limit_sigma min_confidence")
"""Error model of detections: shape (view,), the noise of a detection of confidence 1 in px; the exponent of confidence;
the systematic offset between a model joint and the detector's keypoint, in m; degrees of freedom of the Student t
distribution; the largest squared innovation, in units of its covariance, that passes the gate; the standard deviation
of joint limits; the minimum confidence.
"""


@inline
def variance_factor(keypoint_confidence, exponent):
    """Return the factor of a detection's variance at a confidence; 1 where the detector gives none."""
    if keypoint_confidence != keypoint_confidence or exponent <= 0.0:
        return 1.0
    bounded_confidence = max(keypoint_confidence, 0.05)
    return (
        1.0 / (bounded_confidence * bounded_confidence) if exponent == 1.0 else bounded_confidence ** (-2.0 * exponent)
    )


@inline
def noise_variance(error_model, v, keypoint_confidence, view):
    """Return the variance of a detection, px^2 per axis."""
    scale = (
        error_model.scale_px[v] * error_model.scale_px[v] * variance_factor(keypoint_confidence, error_model.exponent)
    )
    return scale + error_model.floor_m * error_model.floor_m * squared_px_per_m(view)
