"""What every view saw of one person's keypoints, a path each, in the order in which kernels take them."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.kernels.cameras.linearize import linearize
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.label_swaps import Swaps, SwapState
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus, is_used
from posefuse.model.tracks import Tracks
from posefuse.skeleton.skeletons import Skeleton

_FRAMES_PER_S = 30.0
"""Where nobody says when frames were taken."""

_JUDGED = (ViewStatus.USED, ViewStatus.USED_SWAPPED, ViewStatus.OUTLIER, ViewStatus.NOT_USED, ViewStatus.BEHIND_CAMERA)
"""Of a view whose detection is valid, whatever became of it."""


@dataclass(frozen=True, eq=False)
class Measured:
    """A range of frames as measured.

    Attributes:
        rig: the cameras, in the order of the detections' views.
        detections: in memory.
        tracks: whose detection is whose, of the same frames.
        layer: the measured layer of the same frames.
        swaps: which views took left for right, or None where labels are believed.
        noise: of the detections.
    """

    rig: CameraRig
    detections: Detections
    tracks: Tracks
    layer: Layer
    swaps: Swaps | None
    noise: NoiseModel


@dataclass(frozen=True, eq=False)
class Observed:
    """One person's observations; the first axis is the keypoint, the second the frame.

    Attributes:
        rig: the cameras.
        time_s: shape (frame,), increasing.
        pixels: shape (keypoint, frame, view, 2), NaN where there is nothing; left and right put right.
        sigma_px: shape (keypoint, frame, view): standard deviations, inf where an observation does not count.
        agreed: the same shape, bool: whether the measured point rests on it.
        points_m: shape (keypoint, frame, 3): as measured, NaN where missing.
    """

    rig: CameraRig
    time_s: np.ndarray
    pixels: np.ndarray
    sigma_px: np.ndarray
    agreed: np.ndarray
    points_m: np.ndarray

    @classmethod
    def of(cls, given: Measured, person: int) -> Self:
        """The observations of one person."""
        detections, noise = given.detections, given.noise
        rows = given.tracks.rows(detections)[:, person]
        there = rows >= 0
        pixels = np.where(there[..., None, None], np.asarray(detections.keypoints_px)[np.where(there, rows, 0)], np.nan)
        trust = np.where(there[..., None], np.asarray(detections.confidence)[np.where(there, rows, 0)], np.nan)
        status = np.asarray(given.layer.view_status)[:, person]
        exchange_sides(
            pixels, trust, swapped_pairs(detections.skeleton, given.swaps, status, person), detections.skeleton
        )
        trust = np.where(np.isfinite(trust), trust, 1.0)
        with np.errstate(divide="ignore"):
            sigma = noise.scale_px[:, None] / trust**noise.exponent
        sigma = np.where(np.isin(np.moveaxis(status, 1, 2), _JUDGED), sigma, np.inf)
        return cls(
            rig=given.rig,
            time_s=frame_times_s(detections),
            pixels=np.ascontiguousarray(pixels.transpose(2, 0, 1, 3)),
            sigma_px=np.ascontiguousarray(sigma.transpose(2, 0, 1)),
            agreed=np.ascontiguousarray(is_used(status).transpose(1, 0, 2)),
            points_m=np.ascontiguousarray(np.asarray(given.layer.points_m)[:, person].transpose(1, 0, 2)),
        )

    @property
    def step_s(self) -> float:
        """The usual time from one frame to the next."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else 1.0 / _FRAMES_PER_S

    def linear(self, paths_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (keypoint, frame, view, 2) in px, projected less observed, and derivatives (..., 2, 3) at paths."""
        keypoints, frames, views, _ = self.pixels.shape
        n = keypoints * frames
        residuals, jacobians = np.empty((n, views, 2)), np.empty((n, views, 2, 3))
        linearize(
            *self.rig.packed, paths_m.reshape(n, 3), self.pixels.reshape(n, views, 2), residuals, jacobians
        )  # fmt: skip
        return residuals.reshape(self.pixels.shape), jacobians.reshape(*self.pixels.shape, 3)


def swapped_pairs(skeleton: Skeleton, swaps: Swaps | None, view_status: np.ndarray, person: int) -> np.ndarray:
    """Which labels of left and right are to be exchanged, shape (frame, pair, view), bool.

    By the state of the limb; where the measured point rests on a view, by the label it was used with.

    Args:
        skeleton: of the keypoints.
        swaps: states of limbs, or None.
        view_status: shape (frame, keypoint, view), of the measured layer.
        person: by number.
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


def exchange_sides(pixels: np.ndarray, trust: np.ndarray, swapped: np.ndarray, skeleton: Skeleton) -> None:
    """Exchange left and right in place: pixels (frame, view, keypoint, 2), confidence (frame, view, keypoint)."""
    for p, (left, right) in enumerate(skeleton.pair_indices):
        frame, view = np.nonzero(swapped[:, p])
        for values in (pixels, trust):
            values[frame, view, left], values[frame, view, right] = (
                values[frame, view, right],
                values[frame, view, left],
            )


def frame_times_s(detections: Detections) -> np.ndarray:
    """Shape (frame,): when frames were taken, mean over the views that took them; never missing, always increasing.

    Frames without a time lie between or beside those that have one, as their numbers do; without any, they count as
    1/30 s apart.
    """
    numbers = detections.frame_numbers.astype(np.float64)
    known = detections.recorded & np.isfinite(detections.time_s)
    count = known.sum(axis=1)
    with np.errstate(invalid="ignore"):
        times = np.where(known, detections.time_s, 0.0).sum(axis=1) / count
    told = np.isfinite(times)
    if told.sum() < 2:
        return numbers / (detections.rate_hz or _FRAMES_PER_S)
    step = (times[told][-1] - times[told][0]) / (numbers[told][-1] - numbers[told][0])
    offset = np.interp(numbers, numbers[told], times[told] - step * numbers[told])
    filled = np.where(told, times, step * numbers + offset)
    least = 1e-3 * step
    # Two frames at one time would make their difference infinite.
    return np.maximum.accumulate(filled - least * np.arange(len(filled))) + least * np.arange(len(filled))
