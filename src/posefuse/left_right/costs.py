"""What speaks for one orientation or another, in the form the kernels of sides take it."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.kernels.left_right.orientation import link_costs
from posefuse.left_right.estimates import Learned, along_normals
from posefuse.left_right.layout import Layout
from posefuse.left_right.sequence import Sequence

_BONES_AT_MOST = 6.0
_BONES_COUNT = 0.35
_FACING_AT_MOST = 4.0
_FACING_COUNTS = 0.25
"""Poses that bones and symmetry misjudge last some frames; each of these frames counts for so much."""


@dataclass(frozen=True, eq=False)
class Memory:
    """What was seen last of every pair, in the order decided on.

    Attributes:
        points_m: shape (pair, 2, 3).
        covariance_m2: shape (pair, 2, 6).
        points_s: shape (pair, 2): when each point was.
        odds: shape (pair, view): what each view's labels said.
        odds_s: shape (pair, view): when.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    points_s: np.ndarray
    odds: np.ndarray
    odds_s: np.ndarray

    @classmethod
    def empty(cls, n_pairs: int, n_views: int) -> Self:
        """Nothing was seen."""
        return cls(
            np.full((n_pairs, 2, 3), np.nan),
            np.full((n_pairs, 2, 6), np.nan),
            np.full((n_pairs, 2), -np.inf),
            np.zeros((n_pairs, n_views)),
            np.full((n_pairs, n_views), -np.inf),
        )

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """As kernels take them, to be written."""
        return self.points_m, self.covariance_m2, self.points_s, self.odds, self.odds_s

    def copy(self) -> Self:
        """Another of the same."""
        return type(self)(*(array.copy() for array in self.arrays))


def label_weights(layout: Layout, learned: Learned) -> np.ndarray:
    """Shape (pair, view): what a pair's label counts for: labels that go together are not independent witnesses."""
    size = np.bincount(layout.chain_of)[layout.chain_of]
    return 1.0 / (1.0 + (size[:, None] - 1) * learned.alike)


def fields(sequence: Sequence, layout: Layout, learned: Learned) -> np.ndarray:
    """Shape (frame, pair): what exchanging a pair costs by the body's plane of symmetry."""
    cosines = np.nan_to_num(along_normals(sequence, layout, learned.triples))
    if not cosines.shape[-1]:
        return np.zeros(cosines.shape[:2])
    cost = (2.0 * cosines * learned.along / learned.along_sd**2).mean(axis=-1)
    return _FACING_COUNTS * np.clip(cost, -_FACING_AT_MOST, _FACING_AT_MOST)


def links(sequence: Sequence, layout: Layout, learned: Learned) -> np.ndarray:
    """Shape (frame, link): what exchanging one of two linked pairs costs, by bones and by labels that go together."""
    out = np.empty((len(sequence.time_s), len(layout.links)))
    link_costs(
        sequence.points, sequence.odds, layout.links, learned.length, learned.length_sd, learned.likeness,
        learned.likeness_sd, _together(layout, learned), _BONES_AT_MOST, _BONES_COUNT, out,
    )  # fmt: skip
    return out


def _together(layout: Layout, learned: Learned) -> np.ndarray:
    """Shape (link, view): log odds that labels of a chain's pairs go together, beyond what chance makes them."""
    apart = 2.0 * learned.share * (1.0 - learned.share)
    differ = np.maximum(apart * (1.0 - learned.alike), 0.005)
    beyond_chance = np.log((1.0 - differ) / differ) - np.log((1.0 - apart) / apart)
    same = layout.chain_of[layout.links[:, 0]] == layout.chain_of[layout.links[:, 1]]
    return np.where(same[:, None], np.maximum(beyond_chance, 0.0), 0.0)
