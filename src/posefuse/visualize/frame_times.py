"""Assignment of times to the frames of a result."""

from dataclasses import dataclass

import numpy as np

from posefuse.errors import ResultError
from posefuse.model.reconstruction import Reconstruction
from posefuse.preprocess.timeline import fill_missing_times

_TOLERANCE = 1.02
"""Files round times, so slightly more than half a period still counts as the nearest frame."""


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """The times of the frames of a result.

    Attributes:
        numbers: shape (frame,), int64, ascending: frame numbers of the recording.
        time_s: shape (frame,), finite, ascending.
        period_s: time between frames.
        timed: whether the result has times; if not, they are frame numbers times ``period_s``.
    """

    numbers: np.ndarray
    time_s: np.ndarray
    period_s: float
    timed: bool = True

    @classmethod
    def of(cls, result: Reconstruction, rate_hz: float | None = None) -> "FrameTimes":
        """Return the frame times of a result.

        Args:
            result: the result.
            rate_hz: frame rate if the result has none; 30 Hz if that is missing, too.
        """
        numbers = result.frame_numbers
        times_s = fill_missing_times(np.asarray(result.time_s), numbers)
        if not len(numbers) or not np.isfinite(times_s).all():
            period_s = 1.0 / (result.rate_hz or rate_hz or 30.0)
            return cls(numbers, numbers * period_s, period_s, timed=False)
        steps = np.diff(times_s) / np.diff(numbers)
        period_s = float(np.median(steps)) if len(steps) else 0.0
        return cls(numbers, times_s, period_s if period_s > 0 else 1.0 / (result.rate_hz or rate_hz or 30.0))

    @property
    def first_s(self) -> float:
        """Start of the first frame."""
        return float(self.time_s[0]) - self.period_s / 2

    @property
    def end_s(self) -> float:
        """End of the last frame."""
        return float(self.time_s[-1]) + self.period_s / 2

    def nearest(self, time_s: float) -> int | None:
        """Return the index of the frame at a time, or None if there is none within half a period."""
        after = int(np.searchsorted(self.time_s, time_s))
        candidates = [index for index in (after - 1, after) if 0 <= index < len(self.time_s)]
        if not candidates:
            return None
        index = min(candidates, key=lambda each: abs(float(self.time_s[each]) - time_s))
        is_near = abs(float(self.time_s[index]) - time_s) <= _TOLERANCE * self.period_s / 2
        return index if is_near else None

    def time_of_number(self, number: float) -> float:
        """Return the time of a frame number, interpolated or extrapolated if the result does not have it."""
        position = np.interp(number, self.numbers, np.arange(len(self.numbers)))
        inside = float(np.interp(position, np.arange(len(self.time_s)), self.time_s))
        beyond = number - float(np.clip(number, self.numbers[0], self.numbers[-1]))
        return inside + beyond * self.period_s

    def indices_between(self, start_s: float | None, end_s: float | None) -> range:
        """Return the indices of the frames from ``start_s`` to ``end_s`` (exclusive)."""
        first = 0 if start_s is None else int(np.searchsorted(self.time_s, start_s - 1e-9))
        after = len(self.time_s) if end_s is None else int(np.searchsorted(self.time_s, end_s - 1e-9))
        return range(first, max(after, first))


def frames_between(result: Reconstruction, start_s: float | None, end_s: float | None) -> Reconstruction:
    """Return the frames of a result from ``start_s`` to ``end_s`` (exclusive).

    Raises:
        ResultError: if there are none.
    """
    frame_times = FrameTimes.of(result)
    indices = frame_times.indices_between(start_s, end_s)
    if not indices:
        raise no_frames_error(frame_times)
    return result if start_s is None and end_s is None else result.frames(indices[0], indices[-1] + 1)


def no_frames_error(frame_times: FrameTimes) -> ResultError:
    """Return the error for a result without frames in the selected time range."""
    time_s = frame_times.time_s
    if not len(time_s):
        return ResultError("The result has no frames.")
    return ResultError(
        f"The result has no frames in the selected time range. Its frames are from {time_s[0]:.3f} to "
        f"{time_s[-1]:.3f} s."
    )
