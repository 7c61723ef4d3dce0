"""Bone lengths of one body from all comparisons with the views.

A filter that estimates lengths along with the pose takes ends of short bones that errors displace for longer bones, and
it stops after seconds. The comparisons that look for biased lengths are independent of that filter and corrected for
the uncertainty of directions; taken together over a recording, they are several times as accurate.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.skeleton.trees import Tree
from posefuse.tracking.bone_lengths import LengthComparison
from posefuse.tracking.settings import tempering_factor

_MIN_COMPARISONS = 10
"""Number of comparisons from which lengths are taken from them: about as accurate as those of the filter."""
_GROWTH = 1.25
"""Factor by which the number of comparisons grows before lengths are taken from them again: they change slowly, and the
smoother takes longer where they change."""
_MAX_MISFIT = 1.3
"""Size of residuals relative to the noise law beyond which a comparison is left out: bodies are probably mixed up."""


@dataclass
class PooledLengths:
    """Comparisons of one body with the views since the estimate of its lengths began, taken together.

    Attributes:
        information: shape (shape, shape): sum over the comparisons, without a prior; None before the first.
        pull: shape (shape,): product of the information and the measured lengths minus those of the tree.
        count: Number of comparisons.
        last_s: Time of the last comparison, in seconds.
        taken: Number of comparisons when lengths were last taken from them.
    """

    information: np.ndarray | None = None
    pull: np.ndarray | None = None
    count: int = 0
    last_s: float = -np.inf
    taken: int = 0

    def add(self, shown: LengthComparison, memory_s: float) -> None:
        """Add a comparison, tempered for errors with a correlation time in seconds."""
        if shown.misfit > _MAX_MISFIT:
            return
        share = 1.0 / float(tempering_factor(np.array(shown.time_s - self.last_s), memory_s))
        information, pull = share * shown.information, share * shown.pull
        self.information = information if self.information is None else self.information + information
        self.pull = pull if self.pull is None else self.pull + pull
        self.count, self.last_s = self.count + 1, shown.time_s

    @property
    def is_due(self) -> bool:
        """Whether there are enough comparisons, and enough since lengths were last taken from them."""
        return self.count >= max(_MIN_COMPARISONS, _GROWTH * self.taken)

    def take_m(self, tree: Tree) -> np.ndarray:
        """Return the lengths that the comparisons and the tree's prior show, shape (shape,)."""
        self.taken = self.count
        if self.information is None or self.pull is None:
            return np.array(tree.shape_m)
        prior = np.linalg.inv(tree.shape_covariance)
        return np.asarray(tree.shape_m + np.linalg.solve(prior + self.information, self.pull))
