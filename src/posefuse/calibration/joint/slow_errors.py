"""Influence of every error under a working correlation of the errors over time.

A part of the error of a keypoint in a view persists for seconds. The movement of a person relative to it therefore
tells more than the position. As in generalized estimating equations (Liang and Zeger 1986), the observations are
weighted by a working correlation, and the covariance of the estimate follows from the measured one. The working
correlation has a smaller slow part than most detections: full weight would depend on errors that change with the
posture. Where the residuals contain even less of it, its slow part is theirs: the position then counts fully.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from posefuse.calibration.joint.equations import Rows, influences
from posefuse.calibration.joint.noise_law import FAST_S, SLOW_S, NoiseLaw
from posefuse.kernels.calibration.joint import joint_rows

_LEAST_SLOW, _MOST_SLOW = 1e-3, 0.1
"""Bounds of the slow share of a working correlation."""
_PERIOD_S = 1.0
"""Time over which a slow error counts as constant."""
_SMOOTH_S = 0.3


def working_law(measured: NoiseLaw) -> NoiseLaw:
    """Return the working correlation for residuals with a measured correlation."""
    return NoiseLaw(min(max(measured.slow, _LEAST_SLOW), _MOST_SLOW))


def correlated_influences(rows: Rows, runs: np.ndarray, law: NoiseLaw) -> np.ndarray:
    """Return the influence of every error on the score of every parameter, shape (point, view, 2, parameter).

    Args:
        rows: residuals and derivatives.
        runs: shape (sample,), int: contiguous piece of the recording.
        law: working correlation of the errors.
    """
    smooth = _smoothed(rows, runs)
    rays = influences(smooth)
    n_samples, n_columns = rows.points_m.shape[:2]
    size = rays.shape[-1]
    streams = rays.reshape(n_samples, n_columns, -1, size)
    absorbed = _Absorbed.of(smooth)
    periods = _periods(rows.time_s, runs)
    chain = _Chain.of(law, rows.time_s)
    chain.eliminate(
        [absorbed.information(period) for period in periods],
        [streams[period].sum(axis=0) for period in periods],
        [bool(runs[b.start] == runs[a.start]) for a, b in pairwise(periods)],
    )
    out = streams.copy()
    for period, slow in zip(periods, chain.errors(), strict=True):
        out[period] -= absorbed.remaining(period, slow)
    return out.reshape(rays.shape)


def _periods(time_s: np.ndarray, runs: np.ndarray) -> list[slice]:
    """Return the samples of each period."""
    number = np.floor((time_s - time_s[0]) / _PERIOD_S).astype(int)
    starts = np.flatnonzero(np.r_[True, (np.diff(number) != 0) | (np.diff(runs) != 0)])
    return [slice(a, b) for a, b in zip(starts, np.r_[starts[1:], len(number)], strict=True)]


@dataclass(frozen=True, eq=False)
class _Absorbed:
    """What the points absorb of the errors.

    Attributes:
        seen: shape (sample, column, error).
        half: shape (sample, column, error, 3): its product with its transpose is the absorbed part.
    """

    seen: np.ndarray
    half: np.ndarray

    @classmethod
    def of(cls, rows: Rows) -> "_Absorbed":
        """Return the projections of all points."""
        n_samples, n_columns = rows.points_m.shape[:2]
        by_point = rows.by_point.reshape(n_samples, n_columns, -1, 3)
        seen = np.repeat(rows.seen.reshape(n_samples, n_columns, -1), 2, axis=-1).astype(float)
        # Where fewer than two views observe a point, nothing is seen and nothing absorbed.
        normal = np.swapaxes(by_point, -1, -2) @ by_point
        trace = np.trace(normal, axis1=-2, axis2=-1)[..., None, None]
        known = trace > 0.0
        ridge = np.where(known, 1e-9 * trace, 1.0) * np.eye(3)
        root = np.linalg.cholesky(np.linalg.inv(normal + ridge))
        return cls(seen, by_point @ root)

    def information(self, period: slice) -> np.ndarray:
        """Return the information of a period on its slow errors, shape (column, error, error)."""
        half = np.transpose(self.half[period], (1, 2, 0, 3))
        half = half.reshape(*half.shape[:2], -1)
        out = -(half @ np.swapaxes(half, -1, -2))
        at = np.arange(out.shape[-1])
        out[:, at, at] += self.seen[period].sum(axis=0)
        return out

    def remaining(self, period: slice, slow: np.ndarray) -> np.ndarray:
        """Return what points do not absorb of slow errors, shape (sample, column, error, parameter)."""
        half = self.half[period]
        return self.seen[period][..., None] * slow - half @ (np.swapaxes(half, -1, -2) @ slow)


@dataclass(eq=False)
class _Chain:
    """A first-order autoregressive chain of slow errors over the periods, in units of the fast variance."""

    variance: float
    decay: float

    @classmethod
    def of(cls, law: NoiseLaw, time_s: np.ndarray) -> "_Chain":
        """Return the chain of a law; errors that are correlated between samples count less."""
        step_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
        similar = float(np.exp(-step_s / FAST_S))
        fast = (1.0 - law.slow) * (1.0 + similar) / (1.0 - similar)
        return cls(law.slow / fast, float(np.exp(-_PERIOD_S / SLOW_S)))

    def eliminate(self, information: list[np.ndarray], right: list[np.ndarray], joined: list[bool]) -> None:
        """Eliminate the slow errors of one period after the other.

        Args:
            information: per period, shape (column, error, error).
            right: per period, shape (column, error, parameter).
            joined: whether a period and the next belong to the same piece of the recording.
        """
        self._steps: list[tuple[np.ndarray, np.ndarray, float]] = []
        identity = np.eye(information[0].shape[-1])
        step = self.variance * (1.0 - self.decay**2)
        prior, carried = identity / self.variance, np.zeros_like(right[0])
        for k in range(len(information)):
            follows = k < len(joined) and joined[k]
            whole = prior + information[k] + (self.decay**2 / step if follows else 0.0) * identity
            inverse, total = np.linalg.inv(whole), carried + right[k]
            factor = self.decay / step if follows else 0.0
            self._steps.append((inverse, total, factor))
            if follows:
                prior = identity / step - factor**2 * inverse
                carried = factor * (inverse @ total)
            else:
                prior, carried = identity / self.variance, np.zeros_like(right[0])

    def errors(self) -> list[np.ndarray]:
        """Return the slow errors of all periods, each of shape (column, error, parameter)."""
        out: list[np.ndarray] = []
        following: np.ndarray | float = 0.0
        for inverse, total, factor in reversed(self._steps):
            following = inverse @ (total + factor * following)
            out.append(following)
        return out[::-1]


def _smoothed(rows: Rows, runs: np.ndarray) -> Rows:
    """Return the rows with derivatives at points averaged over time.

    Errors of the points move them from sample to sample, which would pretend movement.
    """
    n = len(rows.time_s)
    step_s = float(np.median(np.diff(rows.time_s))) if n > 1 else 1.0
    known = np.isfinite(rows.points_m)
    none = np.zeros((1, *known.shape[1:]))
    sums = np.concatenate([none, np.cumsum(np.where(known, rows.points_m, 0.0), axis=0)])
    counts = np.concatenate([none, np.cumsum(known, axis=0)])
    at = np.arange(n)
    first = np.searchsorted(runs, runs)
    last = np.searchsorted(runs, runs, side="right") - 1
    reach = np.minimum(round(_SMOOTH_S / step_s), np.minimum(at - first, last - at))
    before, after = at - reach, at + reach + 1
    smooth = (sums[after] - sums[before]) / np.maximum(counts[after] - counts[before], 1.0)
    smooth = np.where(known, smooth, np.nan).reshape(-1, 3)
    by_view, by_point = np.empty_like(rows.by_view), np.empty_like(rows.by_point)
    seen = np.where(rows.seen[..., None], np.zeros(2), np.nan)
    motion = (rows.velocity_m_s, np.repeat(rows.time_s, rows.points_m.shape[1]))
    joint_rows(seen, rows.sigma, rows.cameras, smooth, motion, np.empty_like(rows.residual), by_view, by_point)
    return replace(rows, by_view=by_view, by_point=by_point)
