"""How noisy the detections are, from how far they lie from the points they agree on."""

import math
from dataclasses import replace

import numpy as np
from scipy.special import gammaincinv

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus
from posefuse.noise.leave_one_out import Sample, checked, gather
from posefuse.noise.mixture import separate
from posefuse.triangulation.linearized import LinearFit

MOST_ROUNDS = 16

_SAMPLE = 20_000
"""So many observations, spread evenly over the recording, tell the scale to a per cent."""

_FEW = 5_200
_PIECES, _FEW_PIECES = 10, 4
_LEAST_FREEDOM = 1e-6
_FEWEST_POINTS = 30
_ASSUMED_PX_AT_1000 = 4.5
_FINEST_PX_AT_1000 = 0.1
_EXPLAINED = 1.1
_STRIDE = 2.5
_FINEST_PX = 1e-3
_CAMERA_ROUNDS = 3
_CHANCE = 2.0 / math.log(2.0) ** 2
"""Twice the variance that chance gives the logarithm of a camera's median, times the number of pairs; up to so much
cameras count as alike."""
_LEAST_FACTOR, _MOST_FACTOR = 0.5, 4.0


def spans(detections: Detections, *, few: bool = False) -> list[tuple[int, int]]:
    """Ranges of frames that represent a recording: all of a short one, evenly spread pieces of a long one."""
    n_frames = detections.n_frames
    per_frame = len(detections.skeleton) * detections.n_views
    most = min(max((_FEW if few else _SAMPLE) // per_frame, 2 * _PIECES), 60 if few else 300)
    if n_frames <= most:
        return [(0, n_frames)]
    pieces = _FEW_PIECES if few else _PIECES
    length = most // pieces
    starts = np.linspace(0, n_frames - length, pieces).astype(int)
    return [(int(start), int(start) + length) for start in starts]


def assumed(rig: CameraRig, exponent: float) -> NoiseModel:
    """What detectors usually do, where a recording tells too little."""
    return NoiseModel(_ASSUMED_PX_AT_1000 * _widths(rig), exponent, "assumed")


def finest(rig: CameraRig, exponent: float) -> NoiseModel:
    """Where the search for the noise of a recording begins: below any detector's."""
    return NoiseModel(_FINEST_PX_AT_1000 * _widths(rig), exponent, "assumed")


def _widths(rig: CameraRig) -> np.ndarray:
    return np.array([camera.size_px[0] for camera in rig.cameras]) / 1000.0


def coarser(noise: NoiseModel, found: NoiseModel | None) -> NoiseModel | None:
    """The next noise to try, or None if the views that agree err no more than was tried.

    What views agree on depends on the noise, and the noise on what views agree on. Too small a noise leaves only the
    best views in agreement, and they err more than it: coming from below, the first noise that explains itself is
    that of the right detections, however many and however near the wrong ones are. From above it need not be.

    Args:
        noise: tried.
        found: what :func:`estimate` made of it.
    """
    if found is None:
        return replace(noise, scale_px=2.0 * noise.scale_px)
    ratio = float(np.median(found.scale_px) / np.median(noise.scale_px))
    if ratio <= _EXPLAINED:
        return None
    return replace(noise, scale_px=min(ratio, _STRIDE) * noise.scale_px)


def estimate(rig: CameraRig, sample: Sample, layer: Layer, before: NoiseModel) -> NoiseModel | None:
    """The noise of the views that agree, or None where too few do.

    Args:
        rig: the cameras.
        sample: of the recording.
        layer: the sample as the method ``consensus`` triangulates it with the noise ``before``.
        before: the noise so far.
    """
    found = squared_scales(layer, sample.detections, sample.tracks.rows(sample.detections), before.exponent)
    if len(found) < _FEWEST_POINTS:
        return None
    scale = max(float(np.sqrt(np.median(found))), _FINEST_PX)
    return NoiseModel(np.full(len(rig), scale), before.exponent, "estimated")


def of_right_views(rig: CameraRig, sample: Sample, layer: Layer, before: NoiseModel) -> NoiseModel | None:
    """The noise of each camera's right observations, or None where too few points tell.

    Views that are wrong, but not by enough to be rejected, make :func:`estimate` too large; here they are told apart
    by what the other views of the point say. Arguments as of :func:`estimate`.
    """
    told = gather(rig, sample, layer, before)
    points, sigma = told.points, np.where(told.used, told.sigma_px, np.inf)
    if len(sigma) < 2 * _FEWEST_POINTS:
        return None
    found = separate(points.fit(sigma))
    factor = np.full(len(rig), found.scale)
    # What is compared rests on the same views both times.
    both = np.repeat(np.isfinite(sigma[0::2] + sigma[1::2]), 2, axis=0)
    for _ in range(_CAMERA_ROUNDS):
        own = _camera_factors(points.fit(np.where(both, sigma * factor, np.inf)))
        factor *= own
        if (own == 1.0).all():
            break
    if np.ptp(factor) > 0.0:
        factor *= separate(points.fit(sigma * factor), found).scale
    return NoiseModel(np.maximum(before.scale_px * factor, _FINEST_PX), before.exponent, "estimated")


def spread(rig: CameraRig, sample: Sample, layer: Layer, noise: NoiseModel) -> float:
    """How far the errors of accepted observations spread, in units of the noise; 1 where they are as Gaussian as it.

    Heavy tails, and wrong views not told from right ones, lie in it: regions that are to hold what they say must be
    larger by this factor. Arguments as of :func:`estimate`.
    """
    told = gather(rig, sample, layer, noise)
    fit = told.points.fit(told.sigma_px, told.used)
    freedom = fit.degrees_of_freedom.sum()
    return float(np.sqrt(fit.squared.sum() / freedom)) if freedom > _FEWEST_POINTS else 1.0


def _camera_factors(fit: LinearFit) -> np.ndarray:
    """By how much each camera's noise differs from what is assumed, relative to the others, shape (view,).

    From how residuals change from one frame to the next, squared, over the degrees of freedom that the points leave
    a camera; the median, for the sake of wrong ones. What lasts, such as an error of the calibration, says of no camera
    that it is the wrong one; believing the cameras that happen to agree would make them agree the more. Differences
    hardly larger than chance would make them are drawn in (James & Stein 1961).

    Args:
        fit: of pairs of points, one after the other, seen by the same views.
    """
    squares = np.square(fit.residuals[1::2] - fit.residuals[0::2]).sum(axis=-1)
    left = 2.0 - np.trace(fit.shares, axis1=-2, axis2=-1)
    freedom = left[0::2] + left[1::2]
    # A point that is not followed by another one has not changed; residuals that are not free say nothing.
    used = fit.used[0::2] & (squares > 0.0) & (freedom > _LEAST_FREEDOM)
    pairs = used.sum(axis=0)
    if pairs.min() < _FEWEST_POINTS:
        return np.ones(len(pairs))
    # Each by itself, and on the same points: where each sees other people, those would look like another noise. Cameras
    # differ as far as both say so.
    logs = np.log(np.where(used, squares, np.nan) / np.where(used, freedom, np.nan))
    alone = np.nanmedian(logs, axis=0)
    logs = logs[used.sum(axis=1) > 1]
    together = np.nanmedian(logs - np.nanmean(logs, axis=1, keepdims=True), axis=0)
    alone, together = alone - alone.mean(), together - together.mean()
    own = np.where(alone * together > 0.0, np.sign(alone) * np.minimum(np.abs(alone), np.abs(together)), 0.0)
    own -= own.mean()
    kept = max(0.0, 1.0 - _CHANCE * float((1.0 / pairs).mean()) / max(own.var(ddof=1), 1e-12))
    return np.clip(np.exp(0.5 * kept * own), _LEAST_FACTOR, _MOST_FACTOR)


def squared_scales(layer: Layer, detections: Detections, rows: np.ndarray, exponent: float) -> np.ndarray:
    """One estimate of the squared scale from each point whose views check each other.

    With n views a point's weighted squared residuals sum to the squared scale times a chi-square variable of
    2 n - 3 degrees of freedom; dividing by its median gives numbers whose median is the squared scale.

    Args:
        layer: triangulated, wrong views rejected.
        detections: of the same frames.
        rows: shape (frame, person, view): rows of the detections.
        exponent: of the confidence.

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
    telling = checked(status)
    total = (residual**2).sum(axis=-1)[telling]
    freedom = np.maximum(2 * np.arange(used.shape[-1] + 1) - 3, 1)
    medians = 2.0 * gammaincinv(freedom / 2.0, 0.5)
    estimates = total / medians[n[telling]]
    return estimates[np.isfinite(estimates)]
