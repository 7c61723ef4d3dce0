"""Smoothness prior: jerk or acceleration is white noise with a spectral density that adapts to the motion.

Divided differences of neighboring frames are means of the jerk over the frames they span. They are treated as
independent, with the variance of white noise over their share of the time.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.ndimage import uniform_filter1d

from posefuse.kernels.trajectory.band import REACH
from posefuse.model.options.trajectory import SmoothnessPrior

ORDERS: dict[SmoothnessPrior, int] = {"acceleration": 2, "jerk": 3}
"""Order of the derivative of the path that is white noise."""


@dataclass(frozen=True, eq=False)
class Smoothness:
    """Finite differences of neighboring frames.

    Attributes:
        order: order of the derivative.
        differences: shape (row, REACH + 1): coefficients of frames ``row`` to ``row + REACH``.
        time_s: shape (row,): share of the time of each row; its variance is the density divided by that.
    """

    order: int
    differences: np.ndarray
    time_s: np.ndarray

    @classmethod
    def of(cls, prior: SmoothnessPrior, time_s: np.ndarray) -> Self:
        """Return the differences for frame times of shape (frame,)."""
        order = ORDERS[prior]
        rows = max(len(time_s) - order, 0)
        points = np.stack([time_s[a : a + rows] for a in range(order + 1)], axis=-1)
        between = points[:, :, None] - points[:, None, :]
        between[:, range(order + 1), range(order + 1)] = 1.0
        differences = np.zeros((rows, REACH + 1))
        differences[:, : order + 1] = math.factorial(order) / between.prod(axis=2)
        return cls(order, differences, (points[:, -1] - points[:, 0]) / order)

    def stiffness(self, density: np.ndarray, alive: np.ndarray) -> np.ndarray:
        """Return the inverse variance of each row, shape (keypoint, row); 0 where a frame of the row is not alive.

        Args:
            density: shape (keypoint, row), or broadcast to it.
            alive: shape (keypoint, frame), bool.
        """
        rows = len(self.time_s)
        whole = np.ones((len(alive), rows), dtype=bool)
        for a in range(self.order + 1):
            whole &= alive[:, a : a + rows]
        return np.where(whole, self.time_s / density, 0.0)

    def local_density_factor(self, squares: np.ndarray, determined: np.ndarray, window: int, calm: float) -> np.ndarray:
        """Return the local density factor of the motion around each row, shape (keypoint, row).

        Args:
            squares: shape (keypoint, row): squared differences in units of the expected value.
            determined: shape (keypoint, row): number of components that the data determine.
            window: number of rows to average.
            calm: weight of the prior factor 1, in rows.
        """
        if not squares.shape[1]:
            return np.ones_like(squares)
        observed_level = uniform_filter1d(squares, window, axis=1, mode="nearest") * window
        expected = uniform_filter1d(determined, window, axis=1, mode="nearest") * window
        return (3.0 * calm + observed_level) / (3.0 * calm + expected)


def time_constant_s(step_s: float, variance_m2: np.ndarray, density: np.ndarray, order: int) -> np.ndarray:
    """Return the time constant of the smoother, s.

    Args:
        step_s: time between frames.
        variance_m2: of a point from a single frame.
        density: of the prior.
        order: of the prior.
    """
    return (variance_m2 * step_s / density) ** (0.5 / order)


def density_for_time_constant(step_s: float, variance_m2: np.ndarray, time_s: float, order: int) -> np.ndarray:
    """Return the density for which :func:`time_constant_s` is ``time_s``."""
    return variance_m2 * step_s / time_s ** (2 * order)


def alive_frames(seen: np.ndarray, time_s: np.ndarray, max_gap_s: float) -> np.ndarray:
    """Return where a path is defined, shape (keypoint, frame), bool: observed, or in a gap no longer than allowed.

    Args:
        seen: shape (keypoint, frame), bool.
        time_s: shape (frame,).
        max_gap_s: time between the last observed frame before and the first after.
    """
    if seen.all():
        return seen
    before = np.maximum.accumulate(np.where(seen, time_s, -np.inf), axis=1)
    after = np.minimum.accumulate(np.where(seen, time_s, np.inf)[:, ::-1], axis=1)[:, ::-1]
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    # A single missing frame is a gap of two steps between its neighbors.
    return seen | (after - before <= max_gap_s + step * (1.0 + 1e-9))
