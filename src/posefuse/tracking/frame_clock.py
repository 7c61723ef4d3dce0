"""When frames are: views that are late, drop a frame, or record none.

Times of a handful of views are taken as numbers, one by one: arrays of so few cost more to ask than to add up.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.model.frames import Frame

_SAME_TIME_S = 1e-3
"""Views that differ by less are of one time."""
_LEAST_S = 1e-4
SAME_S = 1e-6
"""Durations that differ by less are the same: a double tells seconds since 1970 to 0.24 us."""


@dataclass
class Clock:
    """What time it is for the tracker; goes forward alone.

    Attributes:
        time_s: of the last frame, NaN before the first.
        number: of the last frame.
        period_s: from one frame number to the next, as last seen; NaN if not known.
        views_s: when each view last took a frame, -inf before; empty before the first.
        apart_s: how long after their last frames the views took this one, mostly.
    """

    time_s: float = np.nan
    number: int = 0
    period_s: float = np.nan
    views_s: list[float] = field(default_factory=list)
    apart_s: float = 0.0

    def take(self, frame: Frame) -> float:
        """Go on to a frame; how long after the last it is, s: 0 for the first.

        A frame of no view is one period after the last if nothing else is said. Views may be late by more than the
        others are apart: where a late one drops a frame, the frame is of just after the last.

        Raises:
            DetectionsError: if nothing says when the frame was taken, or it is not later than the last.
        """
        seen_s = frame.taken_s
        time_s = self._time_of(frame, seen_s)
        before = self.time_s
        last_s = self.views_s or [-math.inf] * len(seen_s)
        if time_s <= before:
            if not _goes_on(seen_s, last_s):
                raise DetectionsError(
                    f"Frame {frame.number} is of {time_s:.4f} s, the last was of {before:.4f} s. Frames come in order."
                )
            time_s = before + _LEAST_S
        elif math.isfinite(before):
            self.period_s = (time_s - before) / self._frames_since(frame)
        apart_s = [now - last for now, last in zip(seen_s, last_s, strict=True) if math.isfinite(now - last)]
        self.views_s = [last if math.isnan(now) else now for now, last in zip(seen_s, last_s, strict=True)]
        self.time_s, self.number = time_s, frame.number
        dt_s = 0.0 if math.isnan(before) else time_s - before
        ordered, half = sorted(apart_s), len(apart_s) // 2
        self.apart_s = 0.5 * (ordered[half] + ordered[~half]) if ordered else dt_s
        return dt_s

    def _time_of(self, frame: Frame, seen_s: list[float]) -> float:
        known = [now for now in seen_s if not math.isnan(now)]
        if not known and not len(frame.view):
            known = [said for said in frame.time_s.tolist() if math.isfinite(said)]
            if not known and math.isfinite(self.period_s):
                return self.time_s + self.period_s * self._frames_since(frame)
        if not known:
            raise DetectionsError(
                f"Frame {frame.number} has no time, and how far people move depends on it. Give the frame rate of the "
                "recording (--rate-hz, Options.rate_hz), or times (time_s of a Frame)."
            )
        # Views of a frame that were taken one after the other are taken into account one after the other.
        return math.fsum(known) / len(known) if max(known) - min(known) < _SAME_TIME_S else max(known)

    def _frames_since(self, frame: Frame) -> int:
        """How many frames after the last this is; one if frames are not numbered."""
        return max(1, frame.number - self.number)


def _goes_on(seen_s: list[float], last_s: list[float]) -> bool:
    """Whether some view is later than it was, and none is earlier."""
    ahead = [now - last for now, last in zip(seen_s, last_s, strict=True) if not math.isnan(now)]
    return bool(ahead) and min(ahead) > 0.0


def moments(frame: Frame, time_s: float) -> list[tuple[float, np.ndarray]]:
    """When views took a frame, in order, and which of them, shape (view,), bool; the others with the first.

    Args:
        frame: the frame.
        time_s: of the frame, where no view says it.
    """
    seen_s = frame.taken_s
    there = [now for now in seen_s if not math.isnan(now)]
    if not there or max(there) - min(there) < _SAME_TIME_S:
        return [(max(there, default=time_s), np.ones(len(seen_s), dtype=bool))]
    times = np.where(np.isnan(seen_s), min(there), seen_s)
    rounded = np.round(times / _SAME_TIME_S)
    return [(float(times[rounded == each].max()), rounded == each) for each in np.unique(rounded)]
