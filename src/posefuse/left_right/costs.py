"""Costs of the orientations of pairs, in the form that the kernels of the assignment need."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.kernels.left_right.orientation import link_costs
from posefuse.kernels.left_right.records import LinkModel, PairMemory
from posefuse.left_right.estimates import SideModel, symmetry_cosines
from posefuse.left_right.layout import Layout
from posefuse.left_right.person_sequence import PersonSequence

_MAX_BONE_COST = 6.0
_BONE_WEIGHT = 0.35
"""Weight of bones per frame: poses that bones and symmetry misjudge last several frames."""
_MAX_SYMMETRY_COST = 4.0
_SYMMETRY_WEIGHT = 0.25


@dataclass(frozen=True, eq=False)
class LastObservations:
    """Hold the last observation of every pair, in the decided order.

    Attributes:
        points_m: shape (pair, 2, 3).
        covariance_m2: shape (pair, 2, 6).
        points_s: shape (pair, 2): time of each point.
        odds: shape (pair, view): log odds of each view's labels.
        odds_s: shape (pair, view): time of the labels.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    points_s: np.ndarray
    odds: np.ndarray
    odds_s: np.ndarray

    @classmethod
    def empty(cls, n_pairs: int, n_views: int) -> Self:
        """Return a record without observations."""
        return cls(
            np.full((n_pairs, 2, 3), np.nan),
            np.full((n_pairs, 2, 6), np.nan),
            np.full((n_pairs, 2), -np.inf),
            np.zeros((n_pairs, n_views)),
            np.full((n_pairs, n_views), -np.inf),
        )

    @property
    def arrays(self) -> PairMemory:
        """Return the arrays as the kernels take them, for writing."""
        return PairMemory(self.points_m, self.covariance_m2, self.points_s, self.odds, self.odds_s)


def label_weights(layout: Layout, model: SideModel) -> np.ndarray:
    """Return the weight of each pair's label, shape (pair, view): labels of a chain are not independent."""
    size = np.bincount(layout.chain_of)[layout.chain_of]
    return 1.0 / (1.0 + (size[:, None] - 1) * model.chain_correlation)


def symmetry_costs(sequence: PersonSequence, layout: Layout, model: SideModel) -> np.ndarray:
    """Return the cost of exchanging each pair by the body's plane of symmetry, shape (frame, pair)."""
    cosines = np.nan_to_num(symmetry_cosines(sequence, layout, model.triples))
    if not cosines.shape[-1]:
        return np.zeros(cosines.shape[:2])
    cost = (2.0 * cosines * model.symmetry_cosine / model.symmetry_cosine_sd**2).mean(axis=-1)
    return _SYMMETRY_WEIGHT * np.clip(cost, -_MAX_SYMMETRY_COST, _MAX_SYMMETRY_COST)


def linkage_costs(sequence: PersonSequence, layout: Layout, model: SideModel) -> np.ndarray:
    """Return the cost of exchanging one of two linked pairs, shape (frame, link).

    Cues are bone lengths, parallel vectors, and the correlation of labels within a chain.
    """
    out = np.empty((len(sequence.time_s), len(layout.links)))
    links = LinkModel(
        layout.links, model.length, model.length_sd, model.direction_cosine, model.direction_cosine_sd,
        _label_agreement(layout, model),
    )  # fmt: skip
    link_costs(sequence.points, sequence.odds, links, _MAX_BONE_COST, _BONE_WEIGHT, out)
    return out


def _label_agreement(layout: Layout, model: SideModel) -> np.ndarray:
    """Return log odds beyond chance that two labels of a chain agree, shape (link, view)."""
    differ_by_chance = 2.0 * model.swap_share * (1.0 - model.swap_share)
    differ = np.maximum(differ_by_chance * (1.0 - model.chain_correlation), 0.005)
    beyond_chance = np.log((1.0 - differ) / differ) - np.log((1.0 - differ_by_chance) / differ_by_chance)
    same = layout.chain_of[layout.links[:, 0]] == layout.chain_of[layout.links[:, 1]]
    return np.where(same[:, None], np.maximum(beyond_chance, 0.0), 0.0)
