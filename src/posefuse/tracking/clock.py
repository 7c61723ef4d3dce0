"""When frames are: views that are late, drop a frame, or record none."""

import statistics
from dataclasses import dataclass, field

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.model.frames import Frame

_SAME_TIME_S = 1e-3
"""Views that differ by less are of one time."""
_LEAST_S = 1e-4


@dataclass
class Clock:
    """What time it is for the tracker; goes forward alone.

    Attributes:
        time_s: of the last frame, NaN before the first.
        number: of the last frame.
        period_s: from one frame number to the next, as last seen; NaN if not known.
        views_s: shape (view,): when each view last took a frame.
        apart_s: how long after their last frames the views took this one, mostly.
    """

    time_s: float = np.nan
    number: int = 0
    period_s: float = np.nan
    views_s: np.ndarray = field(default_factory=lambda: np.empty(0))
    apart_s: float = 0.0

    def take(self, frame: Frame) -> float:
        """Go on to a frame; how long after the last it is, s: 0 for the first.

        A frame of no view is one period after the last if nothing else is said. Views may be late by more than the
        others are apart: where a late one drops a frame, the frame is of just after the last.

        Raises:
            DetectionsError: if nothing says when the frame was taken, or it is not later than the last.
        """
        time_s = self._time_of(frame)
        before = self.time_s
        if time_s <= before:
            if not self._goes_on(frame):
                raise DetectionsError(
                    f"Frame {frame.number} is of {time_s:.4f} s, the last was of {before:.4f} s. Frames come in order."
                )
            time_s = before + _LEAST_S
        elif np.isfinite(before):
            self.period_s = (time_s - before) / self._frames_since(frame)
        seen = _taken(frame)
        last = self.views_s if len(self.views_s) else np.full(len(seen), -np.inf)
        apart_s = (frame.time_s - last)[seen & np.isfinite(last)].tolist()
        self.views_s = np.where(seen, frame.time_s, last)
        self.time_s, self.number = time_s, frame.number
        dt_s = 0.0 if np.isnan(before) else time_s - before
        self.apart_s = statistics.median(apart_s) if apart_s else dt_s
        return dt_s

    def _time_of(self, frame: Frame) -> float:
        known = frame.time_s[_taken(frame)]
        if not len(known) and not len(frame.view):
            known = frame.time_s[np.isfinite(frame.time_s)]
            if not len(known) and np.isfinite(self.period_s):
                return self.time_s + self.period_s * self._frames_since(frame)
        if not len(known):
            raise DetectionsError(
                f"Frame {frame.number} has no time, and how far people move depends on it. Give the frame rate of the "
                "recording (--rate-hz, Options.rate_hz), or times (time_s of a Frame)."
            )
        # Views of a frame that were taken one after the other are taken into account one after the other.
        return float(known.mean() if np.ptp(known) < _SAME_TIME_S else known.max())

    def _frames_since(self, frame: Frame) -> int:
        """How many frames after the last this is; one if frames are not numbered."""
        return max(1, frame.number - self.number)

    def _goes_on(self, frame: Frame) -> bool:
        """Whether some view is later than it was, and none is earlier."""
        seen = _taken(frame)
        ahead = frame.time_s[seen] - self.views_s[seen]
        return bool(len(ahead) and (ahead > 0.0).all())


def _taken(frame: Frame) -> np.ndarray:
    """Shape (view,), bool: which views took the frame at a known time."""
    return np.asarray(frame.recorded & np.isfinite(frame.time_s))


def moments(frame: Frame, time_s: float) -> list[tuple[float, np.ndarray]]:
    """When views took a frame, in order, and which of them, shape (view,), bool; the others with the first.

    Args:
        frame: the frame.
        time_s: of the frame, where no view says it.
    """
    known = _taken(frame)
    there = frame.time_s[known]
    if not len(there) or there.max() - there.min() < _SAME_TIME_S:
        return [(float(there.max()) if len(there) else time_s, np.ones(len(known), dtype=bool))]
    times = np.where(known, frame.time_s, there.min())
    rounded = np.round(times / _SAME_TIME_S)
    return [(float(times[rounded == each].max()), rounded == each) for each in np.unique(rounded)]
