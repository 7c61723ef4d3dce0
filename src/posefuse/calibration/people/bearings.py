"""Viewing directions of tracked keypoints over time, for any lens and any frame rate."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posefuse.calibration.people.views import ViewTracks
from posefuse.skeleton.skeletons import Skeleton

MAX_GAP_S = 0.15
"""Largest time between frames that are interpolated; frames further apart are only used at their own times."""

NOISE_SHARE = 0.015
"""Standard deviation of a detection relative to the size of the person in the image: 1 to 3 % for common detectors."""

_CONFIDENCE_FACTORS = (0.7, 4.0)
_MAX_KEYPOINTS = 40
_SPREAD_TO_SIZE = 3.5
_VELOCITY_SPAN_S = 0.2


@dataclass(frozen=True, eq=False)
class Bearings:
    """Hold the viewing directions of the keypoints that identify a person in one view.

    Attributes:
        name: of the camera.
        time_s: shape (frame,), ascending.
        rays: shape (frame, person, keypoint, 3): unit vectors in camera coordinates, NaN where not detected.
        sigma: shape (frame, person, keypoint): nominal standard deviation of a direction per axis, in rad, NaN where
            not detected.
        keypoints: shape (keypoint,), int64: index of each keypoint in the skeleton.
        mirror: shape (keypoint,), int64: place of each keypoint's mirror image, or of itself.
    """

    name: str
    time_s: np.ndarray
    rays: np.ndarray
    sigma: np.ndarray
    keypoints: np.ndarray
    mirror: np.ndarray

    @property
    def n_people(self) -> int:
        """Number of person tracks."""
        return self.rays.shape[1]

    @cached_property
    def period_s(self) -> float:
        """Median time between frames; 0 with a single frame."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else 0.0

    @cached_property
    def _velocity(self) -> np.ndarray:
        """Shape (frame, person, keypoint, 3): change per second across some frames, 0 where it is unknown."""
        n = len(self.time_s)
        step = max(1, round(0.5 * _VELOCITY_SPAN_S / self.period_s)) if self.period_s > 0.0 else 1
        before, after = np.maximum(np.arange(n) - step, 0), np.minimum(np.arange(n) + step, n - 1)
        span = self.time_s[after] - self.time_s[before]
        usable = (span > 0.0) & (span <= 2.0 * MAX_GAP_S)
        span = np.where(usable, span, np.inf)[:, None, None, None]
        return np.nan_to_num((self.rays[after] - self.rays[before]) / span)

    def sample_times(self, n: int) -> np.ndarray:
        """Return the times of at most ``n`` frames with detections, evenly chosen."""
        seen = np.flatnonzero(np.isfinite(self.sigma).any(axis=(1, 2)))
        if len(seen) > n:
            seen = seen[np.unique(np.linspace(0, len(seen) - 1, n).astype(np.int64))]
        return self.time_s[seen]

    def axes(self, person: int) -> np.ndarray:
        """Return orthonormal axes, shape (3, 3), whose last is the mean direction of a person."""
        flat = self.rays[:, person].reshape(-1, 3)
        mean = flat[np.isfinite(flat[:, 0])].sum(axis=0)
        z = mean / max(float(np.linalg.norm(mean)), 1e-12)
        y = np.array([0.0, 1.0, 0.0]) if abs(z[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
        x = np.cross(y, z)
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(z, x), z])

    def at(self, time_s: np.ndarray, person: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Interpolate the directions of one person.

        Args:
            time_s: shape (sample,), timestamps of this view.
            person: index of the person.

        Returns:
            Rays, shape (sample, keypoint, 3), NaN where missing; their velocities per second; and the nominal standard
            deviation, shape (sample, keypoint).
        """
        before, after, nearest, share = self._places(time_s)
        rays = (1.0 - share) * self.rays[before, person] + share * self.rays[after, person]
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        return rays, self._velocity[nearest, person], self.sigma[nearest, person]

    def _places(self, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the frames before and after times, the nearest ones, and the share of the later one, NaN in gaps."""
        last = len(self.time_s) - 1
        after = np.clip(np.searchsorted(self.time_s, time_s), 0, last)
        before = np.maximum(after - 1, 0)
        nearest = np.where(np.abs(self.time_s[before] - time_s) < np.abs(self.time_s[after] - time_s), before, after)
        at_frame = np.abs(self.time_s[nearest] - time_s) < 1e-6
        before, after = np.where(at_frame, nearest, before), np.where(at_frame, nearest, after)
        gap = self.time_s[after] - self.time_s[before]
        inside = (time_s >= self.time_s[before] - 1e-6) & (time_s <= self.time_s[after] + 1e-6)
        usable = inside & (gap <= MAX_GAP_S)
        share = np.where(gap > 0.0, (time_s - self.time_s[before]) / np.where(gap > 0.0, gap, 1.0), 0.0)
        return before, after, nearest, np.where(usable, share, np.nan)[:, None, None]


def bearings_of(view: ViewTracks, skeleton: Skeleton) -> Bearings:
    """Return the directions of the core keypoints of a view.

    Args:
        view: tracks of one view.
        skeleton: of the keypoint axis.
    """
    keypoints = _chosen_keypoints(view, skeleton)
    place = np.full(len(skeleton), -1)
    place[keypoints] = np.arange(len(keypoints))
    mirror = place[skeleton.mirror[keypoints]]
    rays, codes = view.camera.rays(view.keypoints_px[:, :, keypoints])
    rays = np.where((codes == 0)[..., None], rays, np.nan)
    sigma = NOISE_SHARE * _sizes(rays)[..., None] * _confidence_factors(view.confidence[:, :, keypoints])
    sigma = np.where(np.isfinite(rays[..., 0]), sigma, np.nan)
    return Bearings(
        view.camera.name,
        view.time_s,
        rays,
        sigma,
        keypoints,
        np.where(mirror >= 0, mirror, np.arange(len(keypoints))),
    )


def _chosen_keypoints(view: ViewTracks, skeleton: Skeleton) -> np.ndarray:
    """Return the core keypoints; evenly chosen ones if there are many."""
    core = skeleton.core_indices
    if len(core) <= _MAX_KEYPOINTS:
        return core
    return core[np.unique(np.linspace(0, len(core) - 1, _MAX_KEYPOINTS).astype(np.int64))]


def _confidence_factors(confidence: np.ndarray) -> np.ndarray:
    """Return factors of the noise: the inverse of the confidence relative to its median, within bounds."""
    known = confidence[np.isfinite(confidence)]
    typical = float(np.median(known)) if len(known) else 1.0
    if not typical > 0.0:
        return np.ones_like(confidence)
    return np.clip(typical / np.maximum(np.nan_to_num(confidence, nan=typical), 1e-9), *_CONFIDENCE_FACTORS)


def _sizes(rays: np.ndarray) -> np.ndarray:
    """Return the angular size of each detection, shape (frame, person), at least half of the median of its track.

    The size of a person is about 3.5 times the root mean square distance of the core keypoints from their mean.
    """
    seen = np.isfinite(rays[..., 0])
    count = seen.sum(axis=-1)
    filled = np.where(seen[..., None], rays, 0.0)
    mean = filled.sum(axis=2) / np.maximum(count, 1)[..., None]
    squared = np.where(seen, ((filled - mean[:, :, None]) ** 2).sum(axis=-1), 0.0).sum(axis=-1)
    size = np.where(count >= 3, _SPREAD_TO_SIZE * np.sqrt(squared / np.maximum(count, 1)), np.nan)
    for person in range(size.shape[1]):
        known = size[np.isfinite(size[:, person]), person]
        typical = float(np.median(known)) if len(known) else np.nan
        size[:, person] = np.where(count[:, person] > 0, np.fmax(size[:, person], 0.5 * typical), np.nan)
    return size
