"""Table of the solvers of left/right pairs; add one here and in :mod:`posefuse.model.options.pairs`.

The option ``labels`` trusts the labels and needs no solver.
"""

from typing import Protocol

import numpy as np

from posefuse.left_right.pairs import enumerated, population_search
from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.pairs import PairOptions
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.tracks import Tracks


class PairSolver(Protocol):
    """Signature of a pair solver."""

    def __call__(
        self,
        rig: CameraRig,
        detections: Detections,
        tracks: Tracks,
        noise: NoiseModel,
        options: TriangulationOptions,
        pairs: np.ndarray,
        pair_options: PairOptions | None = None,
    ) -> SolvedPairs:
        """Solve every pair of keypoints of every person in a range of frames."""
        ...


SOLVERS: dict[str, PairSolver] = {"enumerate": enumerated.solve, "sds": population_search.solve}
