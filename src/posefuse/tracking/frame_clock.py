"""Times of frames: views that are late, drop a frame, or record none.

The times of a handful of views are processed as scalars: arrays of this size cost more to create than to add.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.model.frames import Frame

_SAME_TIME_S = 1e-3
"""Views whose times differ by less count as simultaneous."""
_MIN_STEP_S = 1e-4
TIME_TOLERANCE_S = 1e-6
"""Durations that differ by less count as equal: a double resolves seconds since 1970 to 0.24 us."""


@dataclass
class FrameClock:
    """Time of the tracker, which only moves forward.

    Attributes:
        time_s: Time of the last frame, in seconds; NaN before the first.
        number: Number of the last frame.
        period_s: Time from one frame number to the next, as last observed; NaN if unknown.
        views_s: Time at which each view last took a frame, -inf before its first; empty before the first frame.
        view_dt_s: Median time between the views' last two frames, in seconds.
    """

    time_s: float = np.nan
    number: int = 0
    period_s: float = np.nan
    views_s: list[float] = field(default_factory=list)
    view_dt_s: float = 0.0

    def advance(self, frame: Frame) -> float:
        """Advance to a frame and return the time since the last one, in seconds; 0 for the first.

        A frame without views is one period after the last unless it states its time. A view may be late by more than
        the others are apart. Where such a view drops a frame, the frame is dated just after the last one.

        Raises:
            DetectionsError: If the frame has no time, or is not later than the last one.
        """
        seen_s = frame.taken_s
        time_s = self._time_of(frame, seen_s)
        before = self.time_s
        last_s = self.views_s or [-math.inf] * len(seen_s)
        if time_s <= before:
            if not _all_later(seen_s, last_s):
                raise DetectionsError(
                    f"Frame {frame.number} is at {time_s:.4f} s, after a frame at {before:.4f} s. Frames must be in "
                    "order of time."
                )
            time_s = before + _MIN_STEP_S
        elif math.isfinite(before):
            self.period_s = (time_s - before) / self._frames_since(frame)
        view_dt_s = [now - last for now, last in zip(seen_s, last_s, strict=True) if math.isfinite(now - last)]
        self.views_s = [last if math.isnan(now) else now for now, last in zip(seen_s, last_s, strict=True)]
        self.time_s, self.number = time_s, frame.number
        dt_s = 0.0 if math.isnan(before) else time_s - before
        ordered, half = sorted(view_dt_s), len(view_dt_s) // 2
        self.view_dt_s = 0.5 * (ordered[half] + ordered[~half]) if ordered else dt_s
        return dt_s

    def _time_of(self, frame: Frame, seen_s: list[float]) -> float:
        known = [now for now in seen_s if not math.isnan(now)]
        if not known and not len(frame.view):
            known = [stated for stated in frame.time_s.tolist() if math.isfinite(stated)]
            if not known and math.isfinite(self.period_s):
                return self.time_s + self.period_s * self._frames_since(frame)
        if not known:
            raise DetectionsError(
                f"Frame {frame.number} has no time, which the motion model needs. Specify the frame rate of the "
                "recording (`rate_hz`), or times (time_s of a Frame)."
            )
        # Views of a frame that were taken one after the other are processed one after the other.
        return math.fsum(known) / len(known) if max(known) - min(known) < _SAME_TIME_S else max(known)

    def _frames_since(self, frame: Frame) -> int:
        """Return the number of frames since the last one; one if frames have no numbers."""
        return max(1, frame.number - self.number)


def _all_later(seen_s: list[float], last_s: list[float]) -> bool:
    """Return whether every view that has a time is later than it was, and at least one has a time."""
    ahead = [now - last for now, last in zip(seen_s, last_s, strict=True) if not math.isnan(now)]
    return bool(ahead) and min(ahead) > 0.0


def differ_in_time(frame: Frame) -> bool:
    """Return whether views took a frame at different times, so that :func:`view_times` returns several."""
    known = [now for now in frame.taken_s if not math.isnan(now)]
    return bool(known) and max(known) - min(known) >= _SAME_TIME_S


def view_times(frame: Frame, time_s: float) -> list[tuple[float, np.ndarray]]:
    """Return the times at which views took a frame, in order, each with a mask of its views, shape (view,).

    Views without a time are grouped with the first.

    Args:
        frame: The frame.
        time_s: Time of the frame if no view has one, in seconds.
    """
    seen_s = frame.taken_s
    known = [now for now in seen_s if not math.isnan(now)]
    if not differ_in_time(frame):
        return [(max(known, default=time_s), np.ones(len(seen_s), dtype=bool))]
    times = np.where(np.isnan(seen_s), min(known), seen_s)
    rounded = np.round(times / _SAME_TIME_S)
    return [(float(times[rounded == each].max()), rounded == each) for each in np.unique(rounded)]
