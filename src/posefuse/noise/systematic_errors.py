"""Increase the noise of cameras whose errors last, as from a wrong pose, clock or lens.

Noise averages out over frames, and a lasting error does not. The variance of the lasting part is therefore multiplied
by the number of independent errors over which points are averaged. A camera that contradicts the others in most of its
detections determines nothing. The noise is increased only if left-out views of the other cameras are predicted as well
as before. See docs/methods/noise.md.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from posefuse.arrays import column_medians
from posefuse.model.cameras import CameraRig
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.tracks import Tracks
from posefuse.noise.leave_one_out import LeaveOneOutPoints, has_three_views, leave_one_out_points
from posefuse.noise.samples import Sample, Samples

Agreement = Callable[[Sample, NoiseModel], Layer]
"""Triangulates a sample so that views that contradict the others are rejected."""

_AVERAGED = 10.0
"""Number of independent errors over which points are averaged. The error of solved points changes little between 5 and
25."""

_MIN_OTHERS = 3
"""Cameras that must agree: with two, nothing predicts a view that is left out."""

_MIN_SHARE = 0.2
"""Lasting variance, relative to the common noise, below which cameras differ by chance."""

_MAX_RATIO = 1.5
"""Cameras with more than this multiple of the median noise are not among those that must agree."""

_MIN_POINTS = 30
_MIN_IN_HALF = 5
"""Points of a keypoint in each half of the sample, from which a median is taken."""

_SIGNIFICANT_SD = 2.5
"""Standard errors over keypoints below which the common part of errors is chance."""

_TOLERANCE = 0.01
"""Largest relative increase of the prediction errors that counts as none."""

_MIN_ERROR_PX = 1e-3
_NEAR = 25.0
_MIN_DETERMINANT = 1e-4


def with_systematic_errors(
    rig: CameraRig, samples: Samples, layer: Layer, noise: NoiseModel, agreement: Agreement
) -> NoiseModel:
    """Return the noise with more of it in cameras with a systematic error.

    Args:
        rig: calibrated cameras.
        samples: samples of the recording.
        layer: the large sample as the method ``consensus`` triangulates it.
        noise: its noise.
        agreement: triangulates a sample.
    """
    if len(rig) <= _MIN_OTHERS:
        return noise
    candidates = np.ones(len(rig), dtype=bool)
    found = leave_one_out_points(rig, samples.large, layer, noise, choose=has_three_views)
    if not len(found.frame):
        return noise
    common_px2 = float(np.median(noise.scale_px)) ** 2
    while candidates.any():
        # The largest error first: the left-out views of the other cameras show a part of it.
        lasting_px2 = np.where(candidates, _lasting_px2(found, noise, layer.points_m.shape[2]), 0.0)
        view = int(lasting_px2.argmax())
        if lasting_px2[view] < _MIN_SHARE * common_px2:
            break
        scale = noise.scale_px.copy()
        scale[view] = np.sqrt(scale[view] ** 2 + (_AVERAGED - 1.0) * lasting_px2[view])
        trial = replace(noise, scale_px=scale)
        noise = trial if predicts_as_well(rig, samples.small, noise, trial, agreement) else noise
        candidates[view] = False
    return noise


def without_views(sample: Sample, views: np.ndarray) -> Sample:
    """Return a sample in which no detection of some views, shape (view,), bool, is assigned."""
    detection = np.where(views, -1, np.asarray(sample.tracks.detection))
    return replace(sample, tracks=Tracks(sample.tracks.person_ids, detection, sample.tracks.state))


def predicts_as_well(
    rig: CameraRig, sample: Sample, noise: NoiseModel, trial: NoiseModel, agreement: Agreement
) -> bool:
    """Return whether more noise of some cameras predicts the others' views as well as before, each left out in turn.

    Errors are averaged over the frames of each piece of the sample. Fewer than three others predict nothing.
    """
    trusted = np.flatnonzero(trial.scale_px < _MAX_RATIO * np.median(trial.scale_px))
    if len(trusted) < _MIN_OTHERS:
        return False
    logs = []
    for view in trusted:
        rows = sample.tracks.rows(sample.detections)[:, :, view]
        pixels = np.asarray(sample.detections.keypoints_px)[np.maximum(rows, 0)]
        seen_px = np.where((rows >= 0)[..., None, None], pixels, np.nan)
        others = without_views(sample, np.arange(len(rig)) == view)
        points = [np.asarray(agreement(others, each).points_m) for each in (noise, trial)]
        errors_px = np.array([rig.cameras[view].project(each)[0] - seen_px for each in points])
        errors_px[:, ~np.isfinite(errors_px).all(axis=(0, -1))] = np.nan
        logs += [_log_means(errors_px[:, start:stop]) for start, stop in pairwise((*sample.starts, len(rows)))]
    before, after = np.concatenate(logs, axis=1).sum(axis=1)
    return bool(after - before <= _TOLERANCE * sum(each.shape[1] for each in logs))


def _lasting_px2(found: LeaveOneOutPoints, noise: NoiseModel, keypoints: int) -> np.ndarray:
    """Return the variance of each camera's lasting errors beyond that of the other cameras, shape (view,), px^2.

    Errors of a keypoint last in all cameras, because a detector places it consistently.
    """
    seen = np.isfinite(found.sigma_px)
    sigma_px = np.where(seen, noise.scale_px / found.confidence**noise.exponent, np.inf)
    fit = found.points.fit(sigma_px)
    residual, inverse = fit.leave_one_out()
    squared = np.einsum("pvi,pvij,pvj->pv", residual, inverse, residual)
    determinant = inverse[..., 0, 0] * inverse[..., 1, 1] - inverse[..., 0, 1] ** 2
    near = fit.used & (squared < _NEAR) & (determinant > _MIN_DETERMINANT)
    error_px = np.where(near[..., None], residual * np.where(near, sigma_px, 0.0)[..., None], np.nan)
    power_px2 = _common_px2(error_px, found.column % keypoints, found.frame < np.median(found.frame))
    known = np.isfinite(power_px2)
    n = known.sum(axis=0)
    mean = np.where(known, power_px2, 0.0).sum(axis=0) / np.maximum(n, 1)
    spread = np.where(known, (power_px2 - mean) ** 2, 0.0).sum(axis=0)
    chance = _SIGNIFICANT_SD * np.sqrt(spread / np.maximum(n * (n - 1), 1))
    excess = np.where((near.sum(axis=0) < _MIN_POINTS) | (mean < chance), 0.0, mean - np.median(mean))
    return np.clip(excess, 0.0, np.square(noise.scale_px))


def _common_px2(error_px: np.ndarray, keypoint: np.ndarray, is_first: np.ndarray) -> np.ndarray:
    """Return what a keypoint's errors have in common in both halves of a sample, (keypoint, view), px^2 per axis.

    The product of the medians of two halves contains no noise that is independent between them.

    Args:
        error_px: shape (point, view, 2), NaN where unknown.
        keypoint: shape (point,).
        is_first: shape (point,), bool: points of the first half.
    """
    number = np.unique(keypoint, return_inverse=True)[1]
    group = 2 * number + ~is_first
    order, views = np.argsort(group, kind="stable"), error_px.shape[1]
    sizes = np.bincount(group, minlength=2 * (number.max(initial=-1) + 1))
    # The points of each keypoint and half in a column of their own, so that one sort finds all medians.
    place = np.arange(len(order)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    columns = np.full((sizes.max(initial=1), len(sizes), views, 2), np.nan)
    columns[place, group[order]] = error_px[order]
    enough = (np.isfinite(columns[..., 0]).sum(axis=0) >= _MIN_IN_HALF).reshape(-1, 2, views).all(axis=1)
    medians = column_medians(columns).reshape(-1, 2, views, 2)
    return np.where(enough, 0.5 * (medians[:, 0] * medians[:, 1]).sum(axis=-1), np.nan)


def _log_means(errors_px: np.ndarray) -> np.ndarray:
    """Return the logarithms of mean errors over frames, shape (noise, column).

    Args:
        errors_px: shape (noise, frame, person, keypoint, 2), NaN where either is unknown.
    """
    n = np.isfinite(errors_px).sum(axis=1)[..., 0]
    mean = np.nansum(errors_px, axis=1)[:, n[0] > 0] / n[:, n[0] > 0, None]
    return np.log(np.maximum(np.linalg.norm(mean, axis=-1), _MIN_ERROR_PX))
