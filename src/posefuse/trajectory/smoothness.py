"""Motion as a prior: jerk, or acceleration, is white noise of a spectral density that follows how lively it is.

Neighbouring frames' divided differences are means of the jerk over the frames they span; they are taken for
independent, of the variance that white noise has over their share of the time.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.ndimage import uniform_filter1d

from posefuse.kernels.trajectory.band import REACH
from posefuse.model.options.trajectory import SmoothnessPrior

ORDERS: dict[SmoothnessPrior, int] = {"acceleration": 2, "jerk": 3}
"""The derivative of the path that is white noise."""


@dataclass(frozen=True, eq=False)
class Smoothness:
    """Differences of neighbouring frames.

    Attributes:
        order: the derivative they are.
        differences: shape (row, REACH + 1): what a row multiplies frames ``row`` to ``row + REACH`` with.
        time_s: shape (row,): its share of the time; its variance is the density over that.
    """

    order: int
    differences: np.ndarray
    time_s: np.ndarray

    @classmethod
    def of(cls, prior: SmoothnessPrior, time_s: np.ndarray) -> Self:
        """Of frames at given times, shape (frame,)."""
        order = ORDERS[prior]
        rows = max(len(time_s) - order, 0)
        points = np.stack([time_s[a : a + rows] for a in range(order + 1)], axis=-1)
        between = points[:, :, None] - points[:, None, :]
        between[:, range(order + 1), range(order + 1)] = 1.0
        differences = np.zeros((rows, REACH + 1))
        differences[:, : order + 1] = math.factorial(order) / between.prod(axis=2)
        return cls(order, differences, (points[:, -1] - points[:, 0]) / order)

    def stiffness(self, density: np.ndarray, alive: np.ndarray) -> np.ndarray:
        """One over each row's variance, shape (keypoint, row); 0 where a row reaches a frame that is not alive.

        Args:
            density: shape (keypoint, row), or broadcast to it.
            alive: shape (keypoint, frame), bool.
        """
        rows = len(self.time_s)
        whole = np.ones((len(alive), rows), dtype=bool)
        for a in range(self.order + 1):
            whole &= alive[:, a : a + rows]
        return np.where(whole, self.time_s / density, 0.0)

    def local(self, squares: np.ndarray, known: np.ndarray, window: int, calm: float) -> np.ndarray:
        """How much livelier than expected the motion is about each row, shape (keypoint, row).

        Args:
            squares: shape (keypoint, row): squared differences over what is expected of them.
            known: shape (keypoint, row): how many numbers the data determine of each.
            window: rows to look at.
            calm: how many rows' worth of 1 stand against them.
        """
        if not squares.shape[1]:
            return np.ones_like(squares)
        lively = uniform_filter1d(squares, window, axis=1, mode="nearest") * window
        told = uniform_filter1d(known, window, axis=1, mode="nearest") * window
        return (3.0 * calm + lively) / (3.0 * calm + told)


def lasting_s(step_s: float, variance_m2: np.ndarray, density: np.ndarray, order: int) -> np.ndarray:
    """How long a path remembers what it was told: the time constant of the smoother, s.

    Args:
        step_s: from frame to frame.
        variance_m2: of what a frame says of the point.
        density: of the prior.
        order: of the prior.
    """
    return (variance_m2 * step_s / density) ** (0.5 / order)


def density_lasting(step_s: float, variance_m2: np.ndarray, time_s: float, order: int) -> np.ndarray:
    """The density with which :func:`lasting_s` is ``time_s``."""
    return variance_m2 * step_s / time_s ** (2 * order)


def alive_frames(seen: np.ndarray, time_s: np.ndarray, max_gap_s: float) -> np.ndarray:
    """Where a path is: seen, or in a gap no longer than allowed; shape (keypoint, frame), bool.

    Args:
        seen: shape (keypoint, frame), bool.
        time_s: shape (frame,).
        max_gap_s: from the frame seen before to the one seen after.
    """
    before = np.maximum.accumulate(np.where(seen, time_s, -np.inf), axis=1)
    after = np.minimum.accumulate(np.where(seen, time_s, np.inf)[:, ::-1], axis=1)[:, ::-1]
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    # A frame missing of itself is a gap of two steps between the frames around it.
    return seen | (after - before <= max_gap_s + step * (1.0 + 1e-9))
