"""What every step of post-processing takes and gives, and which frames follow each other without a break."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source, ViewStatus, is_used

_UNEVEN = 0.5
"""Frames that come more than this share of a period too early or too late do not follow each other."""


@dataclass(frozen=True, eq=False)
class Points:
    """Points over time, those of all people and keypoints side by side.

    Attributes:
        xyz_m: shape (frame, point, 3), NaN where missing.
        covariance_m2: shape (frame, point, 6), NaN where missing or unknown.
        source: shape (frame, point), int8: :class:`Source`.
    """

    xyz_m: np.ndarray
    covariance_m2: np.ndarray
    source: np.ndarray

    @classmethod
    def of(cls, layer: Layer) -> Self:
        """The points of a layer."""
        frames = layer.points_m.shape[0]
        return cls(
            np.asarray(layer.points_m[:]).reshape(frames, -1, 3),
            np.asarray(layer.covariance_m2[:]).reshape(frames, -1, 6),
            np.asarray(layer.source[:]).reshape(frames, -1),
        )

    @property
    def known(self) -> np.ndarray:
        """Shape (frame, point), bool: which have coordinates."""
        return np.asarray(np.isfinite(self.xyz_m).all(axis=-1))

    def into(self, layer: Layer) -> Layer:
        """The layer with these points in place of its own; what has become of them is said by status and source.

        Reprojection errors stay those of the layer: whoever has the detections measures them anew.
        """
        shape = layer.points_m.shape
        known = self.known.reshape(shape[:-1])
        status = np.asarray(layer.status[:]).copy()
        had = status < PointStatus.NOT_SEEN
        dropped = ~known & had
        status[known & ~had] = PointStatus.FILLED
        status[dropped] = PointStatus.OUTLIER
        views = np.asarray(layer.view_status[:]).copy()
        views[dropped[..., None] & is_used(views)] = ViewStatus.NOT_USED
        source = np.where(known, self.source.reshape(shape[:-1]), Source.NONE).astype(np.int8)
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
    """When frames were.

    Attributes:
        time_s: shape (frame,), increasing, NaN where unknown.
        period_s: between frames as a rule.
    """

    time_s: np.ndarray
    period_s: float

    @classmethod
    def of(cls, time_s: np.ndarray, rate_hz: float | None) -> Self:
        """The clock of a recording.

        Args:
            time_s: shape (frame,), of the whole recording.
            rate_hz: nominal, or None where only the times tell it.

        Raises:
            DetectionsError: if neither tells a rate.
        """
        steps = np.diff(time_s)
        steps = steps[steps > 0.0]
        if not len(steps) and rate_hz is None:
            raise DetectionsError(
                "Filling and smoothing need times, and this recording has no frame rate. Read the keypoints with "
                "--rate-hz, or in Python: detections.with_rate(60)."
            )
        return cls(time_s, float(np.median(steps)) if len(steps) else 1.0 / float(rate_hz or 1.0))

    def frames(self, start: int, stop: int) -> "Clock":
        """The frames ``start`` to ``stop``."""
        return Clock(self.time_s[start:stop], self.period_s)

    @property
    def follows(self) -> np.ndarray:
        """Shape (frame - 1,), bool: whether a frame comes a period after the one before."""
        with np.errstate(invalid="ignore"):
            return np.abs(np.diff(self.time_s) - self.period_s) <= _UNEVEN * self.period_s

    def window(self, length_s: float) -> int:
        """The odd number of frames, at least 3, that comes nearest to a length."""
        return max(2 * round((length_s / self.period_s - 1.0) / 2.0) + 1, 3)


def stretches(known: np.ndarray, follows: np.ndarray) -> list[tuple[int, int]]:
    """Unbroken ranges (start, stop) of one point's frames.

    Args:
        known: shape (frame,), bool.
        follows: shape (frame - 1,), bool: which frames come right after the one before.
    """
    joined = known[1:] & known[:-1] & follows
    starts = np.flatnonzero(known & ~np.append(False, joined))
    stops = np.flatnonzero(known & ~np.append(joined, False)) + 1
    return list(zip(starts.tolist(), stops.tolist(), strict=True))
