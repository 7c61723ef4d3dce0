"""Normalize observations under a recording model: undo image transforms, lens, focal length and time offset."""

from dataclasses import dataclass

import numpy as np

from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_model import RecordingModel
from posefuse.model.cameras import Camera

_MIN_STRETCH = 0.2
_MIN_DEPTH = 0.05
_FRAME_TOLERANCE = 0.02
"""Times closer to a frame than this share of the frame interval use that frame without interpolation."""


@dataclass(frozen=True, eq=False)
class NormalizedViews:
    """Hold observations in the image plane of an ideal pinhole camera with focal length 1.

    Attributes:
        xy: shape (sample, column, view, 2): x/z and y/z, NaN where there is no observation.
        pixel_size: shape (sample, column, view): size of a pixel in that plane.
        confidence: shape (sample, column, view).
    """

    xy: np.ndarray
    pixel_size: np.ndarray
    confidence: np.ndarray


def normalize_views(observations: TrackedObservations, model: RecordingModel) -> NormalizedViews:
    """Return the observations of all views at the times of the sampled frames, assuming the model is right."""
    parts = [normalize_view(observations, model, v) for v in range(observations.n_views)]
    return NormalizedViews(
        *(np.stack([getattr(part, name) for part in parts], axis=2) for name in ("xy", "pixel_size", "confidence"))
    )


def normalize_view(observations: TrackedObservations, model: RecordingModel, view: int) -> NormalizedViews:
    """Return the observations of one view; the arrays have no view axis."""
    pixels, confidence = _interpolate_in_time(observations, model, view)
    if model.swapped[view]:
        pixels, confidence = pixels[:, observations.mirror_column], confidence[:, observations.mirror_column]
    camera = observations.rig.cameras[model.cameras[view]]
    scale = model.images[view].scale
    xy, pixel_size = normalized_coordinates(camera, model.images[view].undo(pixels, camera.size_px))
    focal = model.focal_ratio[:, view][:, None]
    xy = xy / focal
    radius2 = np.square(xy).sum(axis=-1)
    # Invert the additional radial distortion by two fixed-point iterations.
    k1 = model.k1_correction[:, view][:, None]
    straightened = xy / (1.0 + k1 * radius2)[..., None]
    xy = xy / (1.0 + k1 * np.square(straightened).sum(axis=-1))[..., None]
    # Undoing the distortion scales local errors by the square root of the area ratio.
    radial = k1 * np.square(xy).sum(axis=-1)
    stretch = 1.0 / np.sqrt(np.maximum(1.0 + radial, _MIN_STRETCH) * np.maximum(1.0 + 3.0 * radial, _MIN_STRETCH))
    return NormalizedViews(xy, stretch * pixel_size / focal.mean(axis=-1) / scale, confidence)


def normalized_coordinates(camera: Camera, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return undistorted x/z and y/z of pixels, shape (..., 2), and the size of a pixel there, shape (...)."""
    rays = camera.rays(np.stack([pixels, pixels + np.array([1.0, 0.0]), pixels + np.array([0.0, 1.0])]))[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        xy = np.where(rays[..., 2:] > _MIN_DEPTH, rays[..., :2] / rays[..., 2:], np.nan)
        along, down = xy[1] - xy[0], xy[2] - xy[0]
        area = np.abs(along[..., 0] * down[..., 1] - along[..., 1] * down[..., 0])
    return xy[0], np.sqrt(area)


def _interpolate_in_time(
    observations: TrackedObservations, model: RecordingModel, view: int
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate pixels and confidences of one view linearly at the times of the sampled frames."""
    taken_s = observations.frame_time_s[model.frames] - model.offset_s[:, view]
    times = observations.time_s[:, view]
    run = observations.runs[model.frames]
    after = (
        np.clip(np.searchsorted(times, taken_s), 1, len(times) - 1) if len(times) > 1 else np.zeros(len(taken_s), int)
    )
    before = np.maximum(after - 1, 0)
    step = np.maximum(times[after] - times[before], 1e-9)
    share = (taken_s - times[before]) / step
    fits = (share > -_FRAME_TOLERANCE) & (share < 1.0 + _FRAME_TOLERANCE)
    near_before, near_after = share < _FRAME_TOLERANCE, share > 1.0 - _FRAME_TOLERANCE
    # Never interpolate across a gap of frames or between pieces of the recording.
    between = (
        (observations.runs[before] == run) & (observations.runs[after] == run) & (step < 2.5 * observations.period_s)
    )
    share = np.where(near_before, 0.0, np.where(near_after, 1.0, share))
    good = fits & (
        near_before & (observations.runs[before] == run) | near_after & (observations.runs[after] == run) | between
    )
    return tuple(  # type: ignore[return-value]
        np.where(_expand(good, values), _lerp(values[:, view], before, after, share), np.nan)
        for values in (observations.pixels, observations.confidence)
    )


def _expand(mask: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Append axes to a mask so that it broadcasts against ``values`` without its view axis."""
    return mask.reshape(-1, *[1] * (values.ndim - 2))


def _lerp(values: np.ndarray, before: np.ndarray, after: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolate linearly between two frames."""
    weight = share.reshape(-1, *[1] * (values.ndim - 1))
    # 0 times NaN is NaN, so a frame of weight 0 must not enter the sum.
    first = np.where(weight < 1.0, values[before] * (1.0 - weight), 0.0)
    return first + np.where(weight > 0.0, values[after] * weight, 0.0)
