"""What a user can choose about keypoints that come in pairs."""

import math
from dataclasses import dataclass, field
from typing import Literal

from posefuse.errors import OptionsError

PairMethod = Literal["enumerate", "sds", "labels"]

PAIR_METHODS: dict[PairMethod, str] = {
    "enumerate": "every view as labelled, swapped, in part or not at all, whichever explains the rays best",
    "sds": "two points apart around the middle of all rays, by a small population search (the specification's)",
    "labels": "the labels are believed, each keypoint is solved by itself",
}
"""Methods for pairs and their line in help; one file each under ``triangulation/pairs/``."""


@dataclass(frozen=True)
class SdsOptions:
    """Of the method `sds`; lengths in mm, as its terms have them.

    Attributes:
        apart_weight: How much it counts that the two points keep apart (e0).
        ray_weight: How much the distances of the points to the rays count (e1).
        equidistance_weight: How much it counts that both are as far from the centre (e2).
        opposite_weight: How much it counts that the centre lies between them (e3).
        separation_mm: Points farther apart than this need not keep apart any more.
        jitter_mm: The spread of the population about the centre at the start.
        agents: How many search.
        max_iterations: When to stop at the latest.
        tolerance_mm: When the population has shrunk to this, the search ends.
    """

    apart_weight: float = 1.0
    ray_weight: float = 1.0
    equidistance_weight: float = 1.0
    opposite_weight: float = 1.0
    separation_mm: float = 20.0
    jitter_mm: float = 15.0
    agents: int = 25
    max_iterations: int = 5000
    tolerance_mm: float = 0.01

    def __post_init__(self) -> None:
        for name in ("apart_weight", "ray_weight", "equidistance_weight", "opposite_weight"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise OptionsError(f"pair_search.sds.{name} must be 0 or more, got {value}.")
        for name in ("separation_mm", "jitter_mm", "tolerance_mm"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise OptionsError(f"pair_search.sds.{name} must be positive, got {value}.")
        if self.agents < 2:
            raise OptionsError(f"pair_search.sds.agents must be at least 2, got {self.agents}.")
        if self.max_iterations < 1:
            raise OptionsError(f"pair_search.sds.max_iterations must be at least 1, got {self.max_iterations}.")


@dataclass(frozen=True)
class PairOptions:
    """How left and right keypoints are told apart.

    Attributes:
        prior_m: How far a keypoint moves from one frame to the next, in m; between two explanations that fit about as
            well, the one nearer to the frame before is taken. By default every frame is solved by itself.
        seed: Of the draws of sds.
        sds: Of the method of that name.
    """

    prior_m: float = math.inf
    seed: int = 0
    sds: SdsOptions = field(default_factory=SdsOptions)

    def __post_init__(self) -> None:
        if not self.prior_m > 0.0:
            raise OptionsError(f"pair_search.prior_m must be positive (inf: no evidence), got {self.prior_m}.")
        if self.seed < 0:
            raise OptionsError(f"pair_search.seed must be 0 or more, got {self.seed}.")
