"""One person's pairs over time, as decisions on sides take them."""

from collections.abc import Sequence as PySequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from posefuse.left_right.layout import Layout
from posefuse.left_right.results import PairsInTime

_ODDS_AT_MOST = 4.0
"""No view's labels of one pair say more: an outlier may look like anything."""


@dataclass(frozen=True, eq=False)
class Sequence:
    """One person's pairs over time, in some order.

    Attributes:
        points: shape (frame, pair, 2, 3), NaN where missing.
        covariance: shape (frame, pair, 2, 6).
        odds: shape (frame, pair, view): logarithms of the odds that the view's labels are swapped against the order.
        time_s: shape (frame,).
        unpaired: shape (frame, U, 3): keypoints without a partner.
    """

    points: np.ndarray
    covariance: np.ndarray
    odds: np.ndarray
    time_s: np.ndarray
    unpaired: np.ndarray

    @classmethod
    def of(cls, given: PairsInTime, layout: Layout, person: int) -> Self:
        """One person's pairs in the order they came in."""
        unpaired = np.full((given.n_frames, len(layout.unpaired), 3), np.nan)
        if given.midline_m is not None:
            unpaired = np.asarray(given.midline_m)[:, person, layout.unpaired]
        points = given.by_frame(given.pairs.points_m)[:, person]
        covariance = given.by_frame(given.pairs.covariance_m2)[:, person]
        present = np.isfinite(points).all(axis=-1, keepdims=True)
        odds = np.clip(0.5 * np.nan_to_num(given.by_frame(given.pairs.evidence)), -_ODDS_AT_MOST, _ODDS_AT_MOST)
        return cls(
            points=np.ascontiguousarray(np.where(present, points, np.nan)),
            covariance=np.ascontiguousarray(np.where(present, covariance, np.nan)),
            odds=np.ascontiguousarray(odds[:, person], dtype=np.float64),
            time_s=np.asarray(given.time_s, dtype=np.float64),
            unpaired=unpaired,
        )

    def frames(self, start: int, stop: int) -> Self:
        """The frames ``start`` to ``stop``."""
        return type(self)(*(getattr(self, field.name)[start:stop] for field in fields(self)))

    @classmethod
    def concatenate(cls, parts: PySequence[Self]) -> Self:
        """Consecutive stretches as one."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))

    def ordered(self, flipped: np.ndarray) -> Self:
        """With the two points of pairs exchanged where ``flipped`` (frame, pair) says so."""
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
        """Shape (frame, pair, 3): from the first to the second point."""
        return self.points[:, :, 1] - self.points[:, :, 0]

    def middle(self, layout: Layout) -> np.ndarray:
        """Shape (frame, U + M, 3): the points of the midline."""
        return np.concatenate([self.unpaired, self.points[:, layout.middles].mean(axis=2)], axis=1)
