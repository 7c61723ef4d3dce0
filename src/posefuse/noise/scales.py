"""Estimate noise scales from the residuals of triangulated points."""

import math
from dataclasses import replace

import numpy as np
from scipy.special import gammaincinv

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus
from posefuse.noise.leave_one_out import has_redundant_views, leave_one_out_points
from posefuse.noise.mixture import fit_mixture
from posefuse.noise.samples import Sample
from posefuse.triangulation.linearized import LinearFit

_MIN_DEGREES_OF_FREEDOM = 1e-6
_MIN_POINTS = 30
_ASSUMED_PX_AT_1000 = 4.5
_SMALLEST_PX_AT_1000 = 0.1
_CONVERGED_RATIO = 1.1
_MAX_STEP_RATIO = 2.5
_MIN_SCALE_PX = 1e-3
_CAMERA_ROUNDS = 3
_CHANCE_VARIANCE = 2.0 / math.log(2.0) ** 2
"""Twice the variance that sampling gives the logarithm of a camera's median, times the number of pairs; cameras that
differ by less count as alike."""
_MIN_FACTOR, _MAX_FACTOR = 0.5, 4.0


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


def common_scale(rig: CameraRig, sample: Sample, layer: Layer, before: NoiseModel) -> NoiseModel | None:
    """Estimate one noise scale for all cameras from the views that agree; None with too few points.

    Args:
        rig: calibrated cameras.
        sample: sample of the recording.
        layer: the sample as the method ``consensus`` triangulates it with the noise ``before``.
        before: the noise so far.
    """
    found = squared_scales(layer, sample.detections, sample.tracks.rows(sample.detections), before.exponent)
    if len(found) < _MIN_POINTS:
        return None
    scale = max(float(np.sqrt(np.median(found))), _MIN_SCALE_PX)
    return NoiseModel(np.full(len(rig), scale), before.exponent, "estimated")


def inlier_scales(rig: CameraRig, sample: Sample, layer: Layer, before: NoiseModel) -> NoiseModel | None:
    """Estimate the noise scale of each camera's inliers; None with too few points.

    Outliers too small to be rejected make :func:`common_scale` too large. Here a mixture model separates them by the
    other views of the point. The arguments are those of :func:`common_scale`.
    """
    found = leave_one_out_points(rig, sample, layer, before)
    points, sigma = found.points, np.where(found.used, found.sigma_px, np.inf)
    if len(sigma) < 2 * _MIN_POINTS:
        return None
    mixture = fit_mixture(points.fit(sigma))
    factor = np.full(len(rig), mixture.scale)
    # Compare only observations that both points of a pair have.
    both = np.repeat(np.isfinite(sigma[0::2] + sigma[1::2]), 2, axis=0)
    for _ in range(_CAMERA_ROUNDS):
        own = _camera_factors(points.fit(np.where(both, sigma * factor, np.inf)))
        factor *= own
        if (own == 1.0).all():
            break
    if np.ptp(factor) > 0.0:
        factor *= fit_mixture(points.fit(sigma * factor), mixture).scale
    return NoiseModel(np.maximum(before.scale_px * factor, _MIN_SCALE_PX), before.exponent, "estimated")


def residual_spread(rig: CameraRig, sample: Sample, layer: Layer, noise: NoiseModel) -> float:
    """Return the standard deviation of accepted observations in units of the noise; 1 for Gaussian errors.

    Heavy tails and undetected outliers increase it. Confidence regions must be larger by this factor to have the
    stated coverage. The arguments are those of :func:`common_scale`.
    """
    found = leave_one_out_points(rig, sample, layer, noise)
    fit = found.points.fit(found.sigma_px, found.used)
    freedom = fit.degrees_of_freedom.sum()
    return float(np.sqrt(fit.squared.sum() / freedom)) if freedom > _MIN_POINTS else 1.0


def _camera_factors(fit: LinearFit) -> np.ndarray:
    """Return the ratio of each camera's noise to the assumed one, relative to the other cameras, shape (view,).

    The ratio follows from squared changes of residuals from one frame to the next, divided by the degrees of freedom
    that the points leave a camera; medians limit the effect of outliers. Constant residuals, such as calibration
    errors, do not show which camera is wrong, and trusting cameras that happen to agree would make them agree more.
    Differences hardly larger than chance are shrunk toward the mean (James & Stein 1961).

    Args:
        fit: pairs of points, one after the other, seen by the same views.
    """
    squares = np.square(fit.residuals[1::2] - fit.residuals[0::2]).sum(axis=-1)
    left = 2.0 - np.trace(fit.shares, axis1=-2, axis2=-1)
    freedom = left[0::2] + left[1::2]
    # A point paired with itself has not changed; residuals without degrees of freedom carry no information.
    used = fit.used[0::2] & (squares > 0.0) & (freedom > _MIN_DEGREES_OF_FREEDOM)
    pairs = used.sum(axis=0)
    if pairs.min() < _MIN_POINTS:
        return np.ones(len(pairs))
    # Estimate each camera alone and on shared points: if cameras see different people, the first would be biased. Use
    # the smaller of the two differences where they agree in sign.
    logs = np.log(np.where(used, squares, np.nan) / np.where(used, freedom, np.nan))
    alone = np.nanmedian(logs, axis=0)
    logs = logs[used.sum(axis=1) > 1]
    together = np.nanmedian(logs - np.nanmean(logs, axis=1, keepdims=True), axis=0)
    alone, together = alone - alone.mean(), together - together.mean()
    own = np.where(alone * together > 0.0, np.sign(alone) * np.minimum(np.abs(alone), np.abs(together)), 0.0)
    own -= own.mean()
    kept = max(0.0, 1.0 - _CHANCE_VARIANCE * float((1.0 / pairs).mean()) / max(own.var(ddof=1), 1e-12))
    return np.clip(np.exp(0.5 * kept * own), _MIN_FACTOR, _MAX_FACTOR)


def squared_scales(layer: Layer, detections: Detections, rows: np.ndarray, exponent: float) -> np.ndarray:
    """Estimate the squared scale from each point with redundant views.

    With n views the sum of a point's weighted squared residuals is the squared scale times a chi-square variable with
    2 n - 3 degrees of freedom. Divided by the median of that variable, the sums have the squared scale as their median.

    Args:
        layer: triangulated points, outliers rejected.
        detections: detections of the same frames.
        rows: shape (frame, person, view): rows of the detections.
        exponent: exponent of the confidence.

    Returns:
        Shape (point,), px^2.
    """
    status = np.asarray(layer.view_status)
    used = status == ViewStatus.USED
    residual = np.where(used, np.asarray(layer.view_error_px, dtype=np.float64), 0.0)
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
