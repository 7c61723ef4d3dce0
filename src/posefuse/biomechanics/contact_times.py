"""Times at which a point of a foot touches and leaves a level, between frames, with standard deviations.

Around a change of contact the velocity of the point relative to the ground is zero on one side and a quadratic
function of time on the other. The time of the change minimizes the sum of squared residuals, as in the regression with
an unknown change point of Hinkley (1969). Velocities are fitted because errors of positions persist over many frames.
"""

from dataclasses import dataclass

import numpy as np

_REST_S, _MOVING_S = 0.10, 0.12
_SEARCH_S = 0.10
_CANDIDATES = 41
_PERIOD_DOUBT = 0.5
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


def contact_intervals(time_s: np.ndarray, relative_m_s: np.ndarray, probability: np.ndarray) -> list[Interval]:
    """Return the intervals in which contact is more probable than not.

    Args:
        time_s: shape (frame,).
        relative_m_s: shape (frame, 3): velocity relative to the ground, NaN where unknown.
        probability: shape (frame,): probability of contact, NaN where unknown, which interrupts contact.
    """
    on = np.nan_to_num(probability) > 0.5
    edges = np.flatnonzero(np.diff(on.astype(np.int8), prepend=0, append=0))
    found = []
    for first, last in edges.reshape(-1, 2):
        # A contact is cut by the recording, or by frames without points.
        begins = first > 0 and np.isfinite(probability[first - 1])
        ends = last < len(on) and np.isfinite(probability[last])
        start, start_sd = -np.inf, np.nan
        if begins:
            start, start_sd = _change_time(
                time_s, relative_m_s, _crossing(time_s, probability, first - 1), leaving=False
            )
        end, end_sd = np.inf, np.nan
        if ends:
            end, end_sd = _change_time(time_s, relative_m_s, _crossing(time_s, probability, last - 1), leaving=True)
        if end > start:
            found.append(Interval(start, end, start_sd, end_sd))
    return found


def _crossing(time_s: np.ndarray, probability: np.ndarray, before: int) -> float:
    """Return the time at which the probability is one half, between a frame and the next one."""
    low, high = probability[before], probability[before + 1]
    return float(time_s[before] + (0.5 - low) / (high - low) * (time_s[before + 1] - time_s[before]))


def _change_time(time_s: np.ndarray, relative_m_s: np.ndarray, guess_s: float, *, leaving: bool) -> tuple[float, float]:
    """Return the time of a change near a guess, and its standard deviation; the guess where frames are missing."""
    sign = 1.0 if leaving else -1.0
    after = sign * (time_s - guess_s)
    near = (after > -_REST_S - _SEARCH_S) & (after < _MOVING_S + _SEARCH_S) & np.isfinite(relative_m_s[:, 0])
    period = float(np.median(np.diff(time_s[near]))) if near.sum() > 1 else float(np.median(np.diff(time_s)))
    if near.sum() < 6:
        return guess_s, 2.0 * period
    tau, velocity = after[near], relative_m_s[near]
    shifts = np.linspace(-_SEARCH_S, _SEARCH_S, _CANDIDATES)
    costs = np.array([_cost(tau - shift, velocity, leaving=leaving) for shift in shifts])
    best = int(costs.argmin())
    # The profile of the cost, in units of the residual variance, is the log-likelihood of the time.
    freedom = max(1, 3 * int(near.sum()) - 7)
    log_likelihood = -0.5 * (costs - costs[best]) / max(costs[best] / freedom, 1e-6)
    weight = np.exp(log_likelihood)
    weight /= weight.sum()
    mean = float(weight @ shifts)
    sd = float(np.sqrt(weight @ np.square(shifts - mean)))
    return guess_s + sign * mean, float(np.hypot(sd, _PERIOD_DOUBT * period / np.sqrt(3.0)))


def _cost(tau: np.ndarray, velocity: np.ndarray, *, leaving: bool) -> float:
    """Return the sum of squared residuals over a fixed set of frames, with the change at ``tau`` zero."""
    moving = np.clip(tau, 0.0, None)
    smooth, sudden = [moving, moving**2], [(tau > 0).astype(float), moving, moving**2]
    if not leaving:
        return _residual(sudden, velocity)
    # Toes leave from rest in walking, and with the speed of the body in a jump, which needs better evidence.
    n = velocity.size
    return min(_residual(smooth, velocity), _residual(sudden, velocity) * n ** (6.0 / n))


def _residual(basis: list[np.ndarray], velocity: np.ndarray) -> float:
    """Return the sum of squared residuals of a regression."""
    design = np.stack(basis, axis=1)
    solution = np.linalg.lstsq(design, velocity, rcond=None)[0]
    return float(np.square(velocity - design @ solution).sum())
