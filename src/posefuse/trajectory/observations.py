"""Observations of one person: every view's keypoints in the array layout of the kernels, one path per keypoint."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from posefuse.arrays import kernel_array
from posefuse.kernels.cameras.linearize import LINEAR_ROWS, linearize, linearize_paths, residuals_px
from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.trajectory.blocks import n_blocks
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.label_swaps import Swaps, SwapState
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus, is_used
from posefuse.model.tracks import Tracks
from posefuse.skeleton.skeletons import Skeleton

_DEFAULT_RATE_HZ = 30.0
"""Assumed frame rate where frame times are unknown."""

_VALID_STATUSES = (
    ViewStatus.USED,
    ViewStatus.USED_SWAPPED,
    ViewStatus.OUTLIER,
    ViewStatus.NOT_USED,
    ViewStatus.BEHIND_CAMERA,
)
"""Statuses of views with a valid detection."""


@dataclass(frozen=True, eq=False)
class MeasuredRange:
    """A range of measured frames.

    Attributes:
        rig: the cameras, in the order of the views of the detections.
        detections: in memory.
        tracks: assignment of detections to people, for the same frames.
        layer: the measured layer of the same frames.
        swaps: views with swapped left and right labels, or None if labels are taken as correct.
        noise: noise model of the detections.
    """

    rig: CameraRig
    detections: Detections
    tracks: Tracks
    layer: Layer
    swaps: Swaps | None
    noise: NoiseModel


@dataclass(frozen=True, eq=False)
class PersonObservations:
    """Observations of one person; the first axis is the keypoint, the second the frame.

    Attributes:
        rig: the cameras.
        time_s: shape (frame,), increasing.
        pixels: shape (keypoint, frame, view, 2), NaN where missing; swapped labels are corrected.
        sigma_px: shape (keypoint, frame, view): standard deviations, inf where an observation does not count.
        agreed: the same shape, bool: whether the measured point uses the observation.
        points_m: shape (keypoint, frame, 3): measured points, NaN where missing.
    """

    rig: CameraRig
    time_s: np.ndarray
    pixels: np.ndarray
    sigma_px: np.ndarray
    agreed: np.ndarray
    points_m: np.ndarray

    @classmethod
    def of(cls, measured_range: MeasuredRange, person: int) -> Self:
        """Return the observations of one person."""
        detections, noise = measured_range.detections, measured_range.noise
        rows = measured_range.tracks.rows(detections)[:, person]
        pixels, confidence = (
            _of_rows(np.asarray(values), rows) for values in (detections.keypoints_px, detections.confidence)
        )
        status = np.asarray(measured_range.layer.view_status)[:, person]
        exchange_sides(
            pixels,
            confidence,
            swapped_pairs(detections.skeleton, measured_range.swaps, status, person),
            detections.skeleton,
        )
        confidence = np.where(np.isfinite(confidence), confidence, 1.0)
        with np.errstate(divide="ignore"):
            sigma = noise.scale_px[:, None] / confidence**noise.exponent
        counts = np.isin(np.moveaxis(status, 1, 2), _VALID_STATUSES) & noise.is_used[:, None]
        sigma = np.where(counts, sigma, np.inf)
        return cls(
            rig=measured_range.rig,
            time_s=frame_times_s(detections),
            pixels=np.ascontiguousarray(pixels.transpose(2, 0, 1, 3)),
            sigma_px=np.ascontiguousarray(sigma.transpose(2, 0, 1)),
            agreed=np.ascontiguousarray(is_used(status).transpose(1, 0, 2)),
            points_m=np.ascontiguousarray(np.asarray(measured_range.layer.points_m)[:, person].transpose(1, 0, 2)),
        )

    @cached_property
    def step_s(self) -> float:
        """Median time between frames, in seconds."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else 1.0 / _DEFAULT_RATE_HZ

    @property
    def has_points(self) -> bool:
        """Whether the person was measured in any frame."""
        return bool(np.isfinite(self.points_m).any())

    def of_keypoints(self, keypoints: np.ndarray) -> Self:
        """Return the observations of some keypoints."""
        return replace(
            self, pixels=self.pixels[keypoints], sigma_px=self.sigma_px[keypoints], agreed=self.agreed[keypoints],
            points_m=self.points_m[keypoints],
        )  # fmt: skip

    def linear_blocks(self, paths_m: np.ndarray) -> np.ndarray:
        """Return the linearized observations, see :func:`linearize_paths`."""
        keypoints, frames, views, _ = self.pixels.shape
        linear = np.empty((keypoints, n_blocks(frames), views, LINEAR_ROWS * BLOCK))
        linearize_paths(self.rig.packed, kernel_array(paths_m), kernel_array(self.pixels), linear)
        return linear

    def linear(self, paths_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (keypoint, frame, view, 2) in px, projected minus observed, and derivatives (..., 2, 3)."""
        return linearize(self.rig.packed, kernel_array(paths_m), kernel_array(self.pixels))

    def residuals_px(self, paths_m: np.ndarray) -> np.ndarray:
        """Return residuals (keypoint, frame, view, 2) in px, projected minus observed, NaN where undefined."""
        return residuals_px(self.rig.packed, kernel_array(paths_m), kernel_array(self.pixels))


def _of_rows(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the values of detections, shape (*rows, ...); NaN where the row is -1."""
    out = np.full((*rows.shape, *values.shape[1:]), np.nan)
    detected = rows >= 0
    out[detected] = values[rows[detected]]
    return out


def swapped_pairs(skeleton: Skeleton, swaps: Swaps | None, view_status: np.ndarray, person: int) -> np.ndarray:
    """Return which left and right labels to exchange, shape (frame, pair, view), bool.

    The state of the limb decides. If the measured point uses a view, the label it was used with decides instead.

    Args:
        skeleton: of the keypoints.
        swaps: states of limbs, or None.
        view_status: shape (frame, keypoint, view), of the measured layer.
        person: person index.
    """
    pairs = skeleton.pair_indices
    swapped = np.zeros((len(view_status), len(pairs), view_status.shape[-1]), dtype=bool)
    if swaps is None or not len(pairs):
        return swapped
    state = np.asarray(swaps.state[:])[:, person] == SwapState.SWAPPED
    of_limb = {pair: limb for limb, chain in reversed(list(skeleton.chains.items())) for pair in chain}
    for p, pair in enumerate(skeleton.pairs):
        name = of_limb.get(pair, pair[0].removeprefix("left_"))
        if name in swaps.chains:
            swapped[:, p] = state[:, :, swaps.chains.index(name)]
    used = view_status[:, pairs]
    exchanged = (used == ViewStatus.USED_SWAPPED).any(axis=2)
    return np.where((used == ViewStatus.USED).any(axis=2) & ~exchanged, False, swapped | exchanged)


def exchange_sides(pixels: np.ndarray, confidence: np.ndarray, swapped: np.ndarray, skeleton: Skeleton) -> None:
    """Exchange left and right in place: pixels (frame, view, keypoint, 2), confidence (frame, view, keypoint)."""
    for p, (left, right) in enumerate(skeleton.pair_indices):
        frame, view = np.nonzero(swapped[:, p])
        for values in (pixels, confidence):
            values[frame, view, left], values[frame, view, right] = (
                values[frame, view, right],
                values[frame, view, left],
            )


def frame_times_s(detections: Detections) -> np.ndarray:
    """Return frame times, shape (frame,): the mean over the recorded views; never missing, always increasing.

    Frames without a time are interpolated or extrapolated by frame number. Without any times, frames are spaced by the
    frame rate, or by 1/30 s if that is unknown.
    """
    numbers = detections.frame_numbers.astype(np.float64)
    valid = detections.recorded & np.isfinite(detections.time_s)
    count = valid.sum(axis=1)
    with np.errstate(invalid="ignore"):
        times = np.where(valid, detections.time_s, 0.0).sum(axis=1) / count
    has_time = np.isfinite(times)
    if has_time.sum() < 2:
        return numbers / (detections.rate_hz or _DEFAULT_RATE_HZ)
    step = (times[has_time][-1] - times[has_time][0]) / (numbers[has_time][-1] - numbers[has_time][0])
    offset = np.interp(numbers, numbers[has_time], times[has_time] - step * numbers[has_time])
    filled = np.where(has_time, times, step * numbers + offset)
    min_step_s = 1e-3 * step
    # Two frames at the same time would make their finite differences infinite.
    return np.maximum.accumulate(filled - min_step_s * np.arange(len(filled))) + min_step_s * np.arange(len(filled))
