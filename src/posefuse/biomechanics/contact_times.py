"""Times at which a point of a foot touches and leaves a level, between frames, with standard deviations.

Around a change of contact the velocity of the point relative to the ground is zero on one side and a quadratic
function of time on the other. The time of the change minimizes the sum of squared residuals, as in the regression with
an unknown change point of Hinkley (1969). Velocities are fitted because errors of positions persist over many frames.
"""

from dataclasses import dataclass

import numpy as np

_REST_S, _MOVING_S = 0.10, 0.16
_SEARCH_S = 0.10
_CANDIDATES = 41
_ROLL_S = 0.03
"""Time by which one part of a foot touches or leaves after the other if the foot rolls."""
_LATER_S = 0.06
"""Usual time from the touch of the first part to that of the second."""
_TILTED_M = 0.015
"""Height of one part of a foot above the other, relative to the resting foot, from which the foot lands tilted."""
_TILT_S = (-0.05, 0.0), (0.12, 0.25)
"""Intervals before and after landing whose tilts are compared."""
_LONGEST_STEP_S = 0.25
_MIN_STEPS = 6
_UNKNOWN_SD_S = 0.03
_DEPENDENT = 1e-10
"""Share of a function that is not a combination of the others below which it is left out of a regression."""
PERIOD_DOUBT = 0.5 / np.sqrt(3.0)
"""Standard deviation of an exact time in frame periods, from the discrete frames."""


@dataclass(frozen=True)
class Interval:
    """Contact of one point.

    Attributes:
        start_s: time of touching, minus infinity if it was before the recording.
        end_s: time of leaving, infinity if it was after the recording.
        start_sd_s: standard deviation of ``start_s``.
        end_sd_s: standard deviation of ``end_s``.
    """

    start_s: float
    end_s: float
    start_sd_s: float
    end_sd_s: float


@dataclass(frozen=True, eq=False)
class _Steps:
    """Velocities of a point relative to the ground between consecutive frames.

    Attributes:
        time_s: shape (step,): middle of the two frames.
        velocity_m_s: shape (step, 3).
    """

    time_s: np.ndarray
    velocity_m_s: np.ndarray

    @classmethod
    def of(cls, time_s: np.ndarray, points_m: np.ndarray, ground_m_s: np.ndarray) -> "_Steps":
        steps = np.diff(points_m, axis=0) / np.diff(time_s)[:, None] - np.array([*ground_m_s, 0.0])
        known = np.isfinite(steps[:, 0]) & (np.diff(time_s) < _LONGEST_STEP_S)
        return cls((0.5 * (time_s[1:] + time_s[:-1]))[known], steps[known])

    def between(self, first_s: float, last_s: float) -> "_Steps":
        """Return the velocities in an interval."""
        first, last = np.searchsorted(self.time_s, [first_s, last_s])
        return _Steps(self.time_s[first:last], self.velocity_m_s[first:last])


def foot_intervals(
    time_s: np.ndarray, points_m: np.ndarray, ground_m_s: np.ndarray, probability: np.ndarray
) -> list[list[Interval]]:
    """Return the intervals in which the heel and the toes of a foot touch.

    When a foot rolls, its second part to touch is fitted from the touch of the first one on, which changes the velocity
    of both; the first part to leave is fitted until the second one leaves.

    Args:
        time_s: shape (frame,).
        points_m: shape (frame, part, 3), NaN where unknown.
        ground_m_s: shape (2,): velocity of the ground.
        probability: shape (frame, part): probability of contact, NaN where unknown, which interrupts contact.
    """
    steps = [_Steps.of(time_s, points_m[:, part], ground_m_s) for part in (0, 1)]
    apart_m = points_m[:, 0, 2] - points_m[:, 1, 2]
    alone = [_intervals(time_s, steps[part], probability[:, part]) for part in (0, 1)]
    return [
        _intervals(time_s, steps[part], probability[:, part], _OtherPart(alone[1 - part], time_s, sign * apart_m))
        for part, sign in ((0, 1.0), (1, -1.0))
    ]


@dataclass(frozen=True, eq=False)
class _OtherPart:
    """The other part of a foot, whose changes of contact limit the fits of a point.

    Attributes:
        intervals: its contact.
        time_s: shape (frame,).
        above_m: shape (frame,): height of the point above the other part.
    """

    intervals: list[Interval]
    time_s: np.ndarray
    above_m: np.ndarray

    def start_before(self, guess_s: float) -> float:
        """Return the touch of the other part that precedes one of the point, or minus infinity."""
        latest = guess_s + (_ROLL_S if self._lands_second(guess_s) else -_ROLL_S)
        return max((each.start_s for each in self.intervals if each.start_s < latest), default=-np.inf)

    def end_after(self, guess_s: float) -> float:
        """Return the time at which the other part leaves after the point, or infinity."""
        return min((each.end_s for each in self.intervals if each.end_s > guess_s + _ROLL_S), default=np.inf)

    def _lands_second(self, guess_s: float) -> bool:
        """Return whether the point is higher than in the resting foot when the foot lands."""
        heights = []
        for first, last in _TILT_S:
            near = self.above_m[slice(*np.searchsorted(self.time_s, [guess_s + first, guess_s + last]))]
            heights.append(float(np.median(near[np.isfinite(near)])) if np.isfinite(near).any() else np.nan)
        return heights[0] - heights[1] > _TILTED_M


def _intervals(
    time_s: np.ndarray, steps: _Steps, probability: np.ndarray, other: _OtherPart | None = None
) -> list[Interval]:
    """Return the intervals in which contact of a point is more probable than not.

    Args:
        time_s: shape (frame,).
        steps: velocities of the point relative to the ground.
        probability: shape (frame,): probability of contact, NaN where unknown, which interrupts contact.
        other: the other part of the foot.
    """
    on = np.nan_to_num(probability) > 0.5
    edges = np.flatnonzero(np.diff(on.astype(np.int8), prepend=0, append=0))
    found = []
    for first, last in edges.reshape(-1, 2):
        # A contact is cut by the recording, or by frames without points.
        begins = first > 0 and np.isfinite(probability[first - 1])
        ends = last < len(on) and np.isfinite(probability[last])
        start, start_sd, end, end_sd = -np.inf, np.nan, np.inf, np.nan
        if begins:
            guess = _crossing(time_s, probability, first - 1)
            limit = -np.inf if other is None else other.start_before(guess)
            start, start_sd = _change_time(steps.between(limit, np.inf), max(guess, limit + _LATER_S), leaving=False)
        if ends:
            guess = _crossing(time_s, probability, last - 1)
            limit = np.inf if other is None else other.end_after(guess)
            end, end_sd = _change_time(steps.between(-np.inf, limit), guess, leaving=True)
        if end > start:
            found.append(Interval(start, end, start_sd, end_sd))
    return found


def _crossing(time_s: np.ndarray, probability: np.ndarray, before: int) -> float:
    """Return the time at which the probability is one half, between a frame and the next one."""
    low, high = probability[before], probability[before + 1]
    return float(time_s[before] + (0.5 - low) / (high - low) * (time_s[before + 1] - time_s[before]))


def _change_time(steps: _Steps, guess_s: float, *, leaving: bool) -> tuple[float, float]:
    """Return the time of a change near a guess, and its standard deviation; the guess where frames are missing."""
    sign = 1.0 if leaving else -1.0
    before, after = _REST_S + _SEARCH_S, _MOVING_S + _SEARCH_S
    near = steps.between(guess_s - (before if leaving else after), guess_s + (after if leaving else before))
    if len(near.time_s) < _MIN_STEPS:
        return guess_s, _UNKNOWN_SD_S
    period = float(np.median(np.diff(near.time_s)))
    tau, velocity = sign * (near.time_s - guess_s), near.velocity_m_s
    shifts = np.linspace(-_SEARCH_S, _SEARCH_S, _CANDIDATES)
    costs = _costs(tau - shifts[:, None], velocity, leaving=leaving)
    mean, sd = weighted_minimum(shifts, costs, max(1, velocity.size - 7))
    return guess_s + sign * mean, float(np.hypot(sd, PERIOD_DOUBT * period))


def weighted_minimum(values: np.ndarray, costs: np.ndarray, freedom: int) -> tuple[float, float]:
    """Return the mean and the standard deviation of a parameter whose log-likelihood is a profile of costs.

    Args:
        values: shape (candidate,).
        costs: shape (candidate,): sums of squared residuals, whose smallest one shows the variance.
        freedom: number of residuals minus that of the parameters.
    """
    best = float(costs.min())
    weight = np.exp(-0.5 * (costs - best) / max(best / freedom, 1e-6))
    weight /= weight.sum()
    mean = float(weight @ values)
    return mean, float(np.sqrt(weight @ np.square(values - mean)))


def _costs(tau: np.ndarray, velocity: np.ndarray, *, leaving: bool) -> np.ndarray:
    """Return the sums of squared residuals over a fixed set of frames, with the change at ``tau`` zero.

    Args:
        tau: shape (candidate, step).
        velocity: shape (step, 3).
        leaving: whether the point leaves the ground.
    """
    moving = np.clip(tau, 0.0, None)
    sudden = _residuals([(tau > 0.0).astype(np.float64), moving, moving**2], velocity)
    if not leaving:
        return sudden
    # Toes leave from rest in walking, and with the speed of the body in a jump, which needs better evidence.
    n = velocity.size
    return np.minimum(_residuals([moving, moving**2], velocity), sudden * n ** (6.0 / n))


def _residuals(basis: list[np.ndarray], velocity: np.ndarray) -> np.ndarray:
    """Return the sums of squared residuals of regressions, shape (candidate,), by orthogonalization.

    Args:
        basis: shape (candidate, step) each; those that the earlier ones determine are left out.
        velocity: shape (step, 3).
    """
    rest = np.broadcast_to(velocity, (len(basis[0]), *velocity.shape)).copy()
    unit: list[np.ndarray] = []
    for column in basis:
        own = column.copy()
        for _ in range(2):
            for other in unit:
                own -= (own * other).sum(axis=1, keepdims=True) * other
        norm, before = np.linalg.norm(own, axis=1), np.linalg.norm(column, axis=1)
        own *= np.where(norm > _DEPENDENT * before, 1.0 / np.maximum(norm, 1e-300), 0.0)[:, None]
        rest -= own[:, :, None] * np.einsum("cs,csj->cj", own, rest)[:, None]
        unit.append(own)
    return np.square(rest).sum(axis=(1, 2))
