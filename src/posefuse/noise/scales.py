"""Estimate noise scales from the residuals of triangulated points."""

from dataclasses import replace

import numpy as np
from scipy.special import gammaincinv

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus
from posefuse.noise.camera_factors import camera_factors
from posefuse.noise.factor_choice import factors_by_prediction
from posefuse.noise.leave_one_out import has_redundant_views, has_three_views, leave_one_out_points
from posefuse.noise.mixture import fit_mixture
from posefuse.noise.samples import Sample

_MIN_POINTS = 30
_ASSUMED_PX_AT_1000 = 4.5
_SMALLEST_PX_AT_1000 = 0.1
_CONVERGED_RATIO = 1.1
_MAX_STEP_RATIO = 2.5
_MIN_SCALE_PX = 1e-3
_MIN_USED_SHARE = 0.4
"""A camera with fewer accepted detections contradicts the others."""

_PREDICTED_OBSERVATIONS = 2400
"""Observations whose prediction decides whether the cameras differ."""

_MAX_NOISE_SHARE = 0.03
"""Largest noise of a camera with a usable calibration, as a share of the longer side of its images."""


def assumed_noise(rig: CameraRig, exponent: float) -> NoiseModel:
    """Return a detector's usual noise, 4.5 px at 1000 px image width, for recordings with too few points."""
    return NoiseModel(_ASSUMED_PX_AT_1000 * _widths(rig), exponent, "assumed")


def smallest_noise(rig: CameraRig, exponent: float) -> NoiseModel:
    """Return the noise at which the search starts, below that of any detector."""
    return NoiseModel(_SMALLEST_PX_AT_1000 * _widths(rig), exponent, "assumed")


def _widths(rig: CameraRig) -> np.ndarray:
    return np.array([camera.size_px[0] for camera in rig.cameras]) / 1000.0


def next_trial(noise: NoiseModel, found: NoiseModel | None) -> NoiseModel | None:
    """Return the next noise to try, or None if the inliers' residuals are no larger than the noise tried.

    Which views agree depends on the noise, and the noise on which views agree. With too small a noise only the best
    views agree, and their residuals exceed it. Searching from below, the first noise that explains its own residuals is
    that of the inliers, whatever the number and distance of the outliers. Searching from above does not ensure this.

    Args:
        noise: the noise tried.
        found: the noise that :func:`common_scale` estimates with it.
    """
    if found is None:
        return replace(noise, scale_px=2.0 * noise.scale_px)
    ratio = float(np.median(found.scale_px) / np.median(noise.scale_px))
    if ratio <= _CONVERGED_RATIO:
        return None
    return replace(noise, scale_px=min(ratio, _MAX_STEP_RATIO) * noise.scale_px)


def common_scale(
    rig: CameraRig, sample: Sample, layer: Layer, before: NoiseModel, factor: np.ndarray
) -> NoiseModel | None:
    """Estimate one noise scale for all cameras from the views that agree; None with too few points.

    Args:
        rig: calibrated cameras.
        sample: sample of the recording.
        layer: the sample as the method ``consensus`` triangulates it with the noise ``before``.
        before: the noise so far.
        factor: shape (view,): each camera's noise relative to the common scale.
    """
    found = squared_scales(layer, sample.detections, sample.tracks.rows(sample.detections), before.exponent, factor)
    if len(found) < _MIN_POINTS:
        return None
    scale = max(float(np.sqrt(np.median(found))), _MIN_SCALE_PX)
    return NoiseModel(scale * factor, before.exponent, "estimated")


def relative_factors(rig: CameraRig, sample: Sample, layer: Layer, noise: NoiseModel) -> tuple[np.ndarray, np.ndarray]:
    """Return each camera's noise relative to the common scale, and which cameras contradict the others.

    The arguments are those of :func:`common_scale`; the noise is equal for all cameras.

    Returns:
        Shape (view,): factors, 1 if that predicts views as well. Shape (view,), bool: cameras with factor 1 of which
        most detections contradict the others.
    """
    found = leave_one_out_points(rig, sample, layer, noise, choose=has_three_views)
    factor = camera_factors(found.points, found.sigma_px)
    seen = np.isfinite(found.sigma_px).sum(axis=0)
    wrong = np.isinf(factor) | ((seen >= _MIN_POINTS) & (found.used.sum(axis=0) < _MIN_USED_SHARE * seen))
    factor = np.where(wrong, 1.0, factor)
    return factors_by_prediction(found.take(_PREDICTED_OBSERVATIONS // len(rig)), factor), wrong


def exceeds_usable_noise(rig: CameraRig, noise: NoiseModel) -> np.ndarray:
    """Return which cameras have more noise than one with a usable calibration, shape (view,), bool."""
    return noise.scale_px > _MAX_NOISE_SHARE * np.array([max(camera.size_px) for camera in rig.cameras])


def inlier_scales(rig: CameraRig, sample: Sample, layer: Layer, before: NoiseModel) -> NoiseModel | None:
    """Estimate the noise scales of inliers, with the ratios that the cameras had; None with too few points.

    Outliers too small to be rejected make :func:`common_scale` too large. Here a mixture model separates them by the
    other views of the point. The arguments are those of :func:`common_scale`.
    """
    found = leave_one_out_points(rig, sample, layer, before)
    sigma = np.where(found.used, found.sigma_px, np.inf)
    if len(sigma) < 2 * _MIN_POINTS:
        return None
    scale = fit_mixture(found.points.fit(sigma)).scale
    return NoiseModel(np.maximum(before.scale_px * scale, _MIN_SCALE_PX), before.exponent, "estimated")


def residual_spread(rig: CameraRig, sample: Sample, layer: Layer, noise: NoiseModel) -> float:
    """Return the standard deviation of accepted observations in units of the noise; 1 for Gaussian errors.

    Heavy tails and undetected outliers increase it. Confidence regions must be larger by this factor to have the
    stated coverage. The arguments are those of :func:`common_scale`.
    """
    found = leave_one_out_points(rig, sample, layer, noise)
    fit = found.points.fit(found.sigma_px, found.used)
    freedom = fit.degrees_of_freedom.sum()
    return float(np.sqrt(fit.squared.sum() / freedom)) if freedom > _MIN_POINTS else 1.0


def squared_scales(
    layer: Layer, detections: Detections, rows: np.ndarray, exponent: float, factor: np.ndarray
) -> np.ndarray:
    """Estimate the squared scale from each point with redundant views.

    With n views the sum of a point's weighted squared residuals is the squared scale times a chi-square variable with
    2 n - 3 degrees of freedom. Divided by the median of that variable, the sums have the squared scale as their median.

    Args:
        layer: triangulated points, outliers rejected.
        detections: detections of the same frames.
        rows: shape (frame, person, view): rows of the detections.
        exponent: exponent of the confidence.
        factor: shape (view,): each camera's noise relative to the common scale.

    Returns:
        Shape (point,), px^2.
    """
    status = np.asarray(layer.view_status)
    used = status == ViewStatus.USED
    residual = np.where(used, np.asarray(layer.view_error_px, dtype=np.float64) / factor, 0.0)
    if exponent > 0:
        trust = np.moveaxis(np.asarray(detections.confidence)[np.maximum(rows, 0)], -1, -2)
        residual *= np.where(used & np.isfinite(trust), trust, 1.0) ** exponent
    n = used.sum(axis=-1)
    redundant = has_redundant_views(status)
    total = (residual**2).sum(axis=-1)[redundant]
    freedom = np.maximum(2 * np.arange(used.shape[-1] + 1) - 3, 1)
    medians = 2.0 * gammaincinv(freedom / 2.0, 0.5)
    estimates = total / medians[n[redundant]]
    return estimates[np.isfinite(estimates)]
