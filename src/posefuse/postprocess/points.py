"""Points over time and their clock, the input and output of every post-processing step."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source, ViewStatus, is_used

_MAX_JITTER = 0.5
"""Frames that deviate from the period by more than this share are not contiguous."""


@dataclass(frozen=True, eq=False)
class Points:
    """Hold points over time, with all people and keypoints in one axis.

    Attributes:
        xyz_m: shape (frame, point, 3), NaN where missing.
        covariance_m2: shape (frame, point, 6), NaN where missing.
        source: shape (frame, point), int8: :class:`Source`.
    """

    xyz_m: np.ndarray
    covariance_m2: np.ndarray
    source: np.ndarray

    @classmethod
    def of(cls, layer: Layer) -> Self:
        """Return the points of a layer."""
        frames = layer.points_m.shape[0]
        return cls(
            np.asarray(layer.points_m[:]).reshape(frames, -1, 3),
            np.asarray(layer.covariance_m2[:]).reshape(frames, -1, 6),
            np.asarray(layer.source[:]).reshape(frames, -1),
        )

    @property
    def known(self) -> np.ndarray:
        """Return which points have coordinates, shape (frame, point), bool."""
        return np.asarray(np.isfinite(self.xyz_m).all(axis=-1))

    def into(self, layer: Layer) -> Layer:
        """Return the layer with these points; status and source state what changed.

        Reprojection errors stay those of the layer; they are recomputed where the detections are available.
        """
        shape = layer.points_m.shape
        known = self.known.reshape(shape[:-1])
        source = np.where(known, self.source.reshape(shape[:-1]), Source.NONE).astype(np.int8)
        status = np.asarray(layer.status[:]).copy()
        dropped = ~known & (status < PointStatus.NOT_SEEN)
        # A point that was dropped and filled again does not rest on its views.
        filled = known & (source == Source.FILLED)
        status[filled] = PointStatus.FILLED
        status[dropped] = PointStatus.OUTLIER
        views = np.asarray(layer.view_status[:]).copy()
        views[(dropped | filled)[..., None] & is_used(views)] = ViewStatus.NOT_USED
        return replace(
            layer,
            points_m=self.xyz_m.reshape(shape),
            covariance_m2=self.covariance_m2.reshape(*shape[:-1], 6),
            status=status,
            source=source,
            view_status=views,
        )


@dataclass(frozen=True, eq=False)
class Clock:
    """Hold the times of frames.

    Attributes:
        time_s: shape (frame,), increasing, NaN where unknown.
        period_s: typical time between frames.
    """

    time_s: np.ndarray
    period_s: float

    @classmethod
    def of(cls, time_s: np.ndarray, rate_hz: float | None) -> Self:
        """Return the clock of a recording.

        Args:
            time_s: shape (frame,), of the whole recording.
            rate_hz: nominal frame rate, or None to derive it from the times.

        Raises:
            DetectionsError: if the frame rate is unknown.
        """
        steps = np.diff(time_s)
        steps = steps[steps > 0.0]
        if not len(steps) and rate_hz is None:
            raise DetectionsError(
                "Filling and smoothing need frame times, and this recording has no frame rate. Set `rate_hz`."
            )
        return cls(time_s, float(np.median(steps)) if len(steps) else 1.0 / float(rate_hz or 1.0))

    def frames(self, start: int, stop: int) -> "Clock":
        """Return the clock of the frames ``start`` to ``stop``."""
        return Clock(self.time_s[start:stop], self.period_s)

    @property
    def is_contiguous(self) -> np.ndarray:
        """Return whether each frame follows the previous one after one period, shape (frame - 1,), bool."""
        with np.errstate(invalid="ignore"):
            return np.abs(np.diff(self.time_s) - self.period_s) <= _MAX_JITTER * self.period_s

    def window(self, length_s: float) -> int:
        """Return the odd number of frames, at least 3, closest to a duration."""
        return max(2 * round((length_s / self.period_s - 1.0) / 2.0) + 1, 3)


def contiguous_ranges(known: np.ndarray, is_contiguous: np.ndarray) -> list[tuple[int, int]]:
    """Return contiguous ranges (start, stop) of one point's frames.

    Args:
        known: shape (frame,), bool.
        is_contiguous: shape (frame - 1,), bool: frames that directly follow the previous one.
    """
    joined = known[1:] & known[:-1] & is_contiguous
    starts = np.flatnonzero(known & ~np.append(False, joined))
    stops = np.flatnonzero(known & ~np.append(joined, False)) + 1
    return list(zip(starts.tolist(), stops.tolist(), strict=True))
