"""Which frame of a result a time belongs to."""

from dataclasses import dataclass

import numpy as np

from posefuse.errors import ResultError
from posefuse.model.detections import with_lacking_times
from posefuse.model.reconstruction import Reconstruction

_SLACK = 1.02
"""Times are rounded in files: a little more than half a period is still the nearest frame."""


@dataclass(frozen=True, eq=False)
class Clock:
    """The frames of a result in time.

    Attributes:
        numbers: shape (frame,), int64, ascending: of the frames in the recording.
        time_s: shape (frame,): of each, finite, ascending.
        period_s: between frames.
        timed: whether the result says when its frames were taken; if not, a frame is taken to last ``period_s``.
    """

    numbers: np.ndarray
    time_s: np.ndarray
    period_s: float
    timed: bool = True

    @classmethod
    def of(cls, result: Reconstruction, rate_hz: float | None = None) -> "Clock":
        """The clock of a result.

        Args:
            result: whose frames.
            rate_hz: of its frames where it does not say itself; 30 if nobody says.
        """
        numbers = result.frame_numbers
        times_s = with_lacking_times(np.asarray(result.time_s), numbers)
        if not len(numbers) or not np.isfinite(times_s).all():
            period_s = 1.0 / (result.rate_hz or rate_hz or 30.0)
            return cls(numbers, numbers * period_s, period_s, timed=False)
        steps = np.diff(times_s) / np.diff(numbers)
        usual_s = float(np.median(steps)) if len(steps) else 0.0
        return cls(numbers, times_s, usual_s if usual_s > 0 else 1.0 / (result.rate_hz or rate_hz or 30.0))

    @property
    def first_s(self) -> float:
        """When the first frame begins."""
        return float(self.time_s[0]) - self.period_s / 2

    @property
    def end_s(self) -> float:
        """When the last frame has ended."""
        return float(self.time_s[-1]) + self.period_s / 2

    def nearest(self, time_s: float) -> int | None:
        """The place of the frame at a time, None where the result has none within half a period."""
        after = int(np.searchsorted(self.time_s, time_s))
        near = [place for place in (after - 1, after) if 0 <= place < len(self.time_s)]
        if not near:
            return None
        place = min(near, key=lambda each: abs(float(self.time_s[each]) - time_s))
        within = abs(float(self.time_s[place]) - time_s) <= _SLACK * self.period_s / 2
        return place if within else None

    def time_of_number(self, number: float) -> float:
        """When the frame of a number was taken, also of numbers that the result does not have."""
        places = np.interp(number, self.numbers, np.arange(len(self.numbers)))
        inside = float(np.interp(places, np.arange(len(self.time_s)), self.time_s))
        beyond = number - float(np.clip(number, self.numbers[0], self.numbers[-1]))
        return inside + beyond * self.period_s

    def places(self, start_s: float | None, end_s: float | None) -> range:
        """The frames from one time to another (exclusive)."""
        first = 0 if start_s is None else int(np.searchsorted(self.time_s, start_s - 1e-9))
        after = len(self.time_s) if end_s is None else int(np.searchsorted(self.time_s, end_s - 1e-9))
        return range(first, max(after, first))


def frames_between(result: Reconstruction, start_s: float | None, end_s: float | None) -> Reconstruction:
    """The frames of a result from one time to another (exclusive).

    Raises:
        ResultError: if it has none there.
    """
    clock = Clock.of(result)
    places = clock.places(start_s, end_s)
    if not places:
        raise nothing_between(clock)
    return result if start_s is None and end_s is None else result.frames(places[0], places[-1] + 1)


def nothing_between(clock: Clock) -> ResultError:
    """What to say where a result has no frame in the chosen time."""
    if not len(clock.time_s):
        return ResultError("This result has no frame, so there is nothing to show.")
    return ResultError(
        f"The result has no frame in the chosen time; it goes from {clock.time_s[0]:.3f} to {clock.time_s[-1]:.3f} s."
    )
