"""Pairs of one person over time, as input for the assignment of left and right."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.left_right.layout import Layout
from posefuse.left_right.results import PairSequence

_MAX_LOG_ODDS = 4.0
"""Bound on the log odds of one label: an outlier can resemble anything."""


@dataclass(frozen=True, eq=False)
class PersonSequence:
    """Hold the pairs of one person over time, in some order of their two points.

    Attributes:
        points: shape (frame, pair, 2, 3), NaN where missing.
        covariance: shape (frame, pair, 2, 6).
        odds: shape (frame, pair, view): log odds that the view's labels are swapped relative to the order.
        time_s: shape (frame,).
        unpaired: shape (frame, U, 3): keypoints without an opposite side.
    """

    points: np.ndarray
    covariance: np.ndarray
    odds: np.ndarray
    time_s: np.ndarray
    unpaired: np.ndarray

    @classmethod
    def of(cls, pairs: PairSequence, layout: Layout, person: int) -> Self:
        """Return the pairs of one person in their original order."""
        unpaired = np.full((pairs.n_frames, len(layout.unpaired), 3), np.nan)
        if pairs.midline_m is not None:
            unpaired = np.asarray(pairs.midline_m)[:, person, layout.unpaired]
        points = pairs.by_frame(pairs.pairs.points_m)[:, person]
        covariance = pairs.by_frame(pairs.pairs.covariance_m2)[:, person]
        present = np.isfinite(points).all(axis=-1, keepdims=True)
        odds = np.clip(0.5 * np.nan_to_num(pairs.by_frame(pairs.pairs.evidence)), -_MAX_LOG_ODDS, _MAX_LOG_ODDS)
        return cls(
            points=np.ascontiguousarray(np.where(present, points, np.nan)),
            covariance=np.ascontiguousarray(np.where(present, covariance, np.nan)),
            odds=np.ascontiguousarray(odds[:, person], dtype=np.float64),
            time_s=np.asarray(pairs.time_s, dtype=np.float64),
            unpaired=unpaired,
        )

    def ordered(self, flipped: np.ndarray) -> Self:
        """Return the sequence with the two points exchanged where ``flipped`` (frame, pair) is true."""
        which = flipped[..., None, None]
        return type(self)(
            np.where(which, self.points[:, :, ::-1], self.points),
            np.where(which, self.covariance[:, :, ::-1], self.covariance),
            np.where(flipped[..., None], -self.odds, self.odds),
            self.time_s,
            self.unpaired,
        )

    @property
    def across(self) -> np.ndarray:
        """Return vectors from the first to the second point, shape (frame, pair, 3)."""
        return self.points[:, :, 1] - self.points[:, :, 0]

    def middle(self, layout: Layout) -> np.ndarray:
        """Return the points of the midline, shape (frame, U + M, 3)."""
        return np.concatenate([self.unpaired, self.points[:, layout.middles].mean(axis=2)], axis=1)
