"""Options of the joint solution of left/right keypoint pairs."""

import math
from dataclasses import dataclass, field
from typing import Literal

from posefuse.model.options.bounds import check_fields, option

PairMethod = Literal["enumerate", "sds", "labels"]

PAIR_METHODS: dict[PairMethod, str] = {
    "enumerate": "tries every labeling of the views, as labeled or swapped, and takes the one with the smallest cost",
    "sds": "fits two separated points to all rays by a population search (the specification's method)",
    "labels": "trusts the labels and solves each keypoint independently",
}
"""Methods for left/right pairs and their line in help."""


@dataclass(frozen=True)
class SdsOptions:
    """Options of the pair method sds, a population search; lengths are in mm, as in the specification.

    Attributes:
        separation_weight: Weight of the term that keeps the two points apart (e0).
        ray_weight: Weight of the distances between the points and the rays (e1).
        equidistance_weight: Weight of the term that keeps both points equally far from the center (e2).
        opposite_weight: Weight of the term that keeps the center between the two points (e3).
        separation_mm: Distance between the two points beyond which the separation term is zero.
        jitter_mm: Standard deviation of the initial population around the center.
        agents: Number of agents in the population.
        max_iterations: Maximum number of iterations.
        tolerance_mm: Length of the agents' last steps at which the search stops.
    """

    separation_weight: float = option(1.0, at_least=0.0)
    ray_weight: float = option(1.0, at_least=0.0)
    equidistance_weight: float = option(1.0, at_least=0.0)
    opposite_weight: float = option(1.0, at_least=0.0)
    separation_mm: float = option(20.0, above=0.0)
    jitter_mm: float = option(15.0, above=0.0)
    agents: int = option(25, at_least=2, at_most=10_000)
    max_iterations: int = option(5000, at_least=1, at_most=1_000_000)
    tolerance_mm: float = option(0.01, above=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "pair_search.sds")


@dataclass(frozen=True)
class PairOptions:
    """Options of the search for the two points of a left/right pair.

    Attributes:
        motion_sd_m: Standard deviation of a keypoint's motion between frames, which resolves ambiguous labelings; inf
            solves every frame independently.
        seed: Random seed of the method `sds`.
        sds: Options of the pair method `sds`.
    """

    motion_sd_m: float = option(math.inf, above=0.0, infinite=True)
    seed: int = option(0, at_least=0)
    sds: SdsOptions = field(default_factory=SdsOptions)

    def __post_init__(self) -> None:
        check_fields(self, "pair_search")
