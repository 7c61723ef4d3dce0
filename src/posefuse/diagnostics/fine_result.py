"""Records of the fine search: linearizations, accepted faults and the result."""

from dataclasses import dataclass

import numpy as np

from posefuse.diagnostics.hypotheses import Evaluation, Hypothesis
from posefuse.diagnostics.linear_system import LinearSystem
from posefuse.diagnostics.recording_model import RecordingModel
from posefuse.diagnostics.sample_points import SamplePoints


@dataclass(frozen=True, eq=False)
class Linearization:
    """Hold a recording model with its triangulated points and linearized problem.

    Attributes:
        model: hypothesis about the recording.
        points: triangulated samples.
        system: linearized there.
    """

    model: RecordingModel
    points: SamplePoints
    system: LinearSystem


@dataclass(frozen=True, eq=False)
class AcceptedFault:
    """Hold an accepted hypothesis.

    Attributes:
        evaluation: evaluation at the time of acceptance.
        values: shape (unknown,): estimated jointly with all accepted hypotheses.
        sds: shape (unknown,): standard deviations of the values.
        competitors: other hypotheses of similar gain, about other views or other kinds of faults.
    """

    evaluation: Evaluation
    values: np.ndarray
    sds: np.ndarray
    competitors: tuple[Evaluation, ...] = ()

    @property
    def hypothesis(self) -> Hypothesis:
        """Return the accepted hypothesis."""
        return self.evaluation.hypothesis


@dataclass(frozen=True, eq=False)
class FineResult:
    """Hold the result of the fine search.

    Attributes:
        initial: linearization before any correction.
        final: linearization with all accepted corrections.
        accepted: accepted faults, the most certain first.
        design_effect: typical number of correlated observations that carry the information of one.
        complete: whether the search ended because no further fault helps, and not at its bound.
    """

    initial: Linearization
    final: Linearization
    accepted: tuple[AcceptedFault, ...]
    design_effect: float
    complete: bool = True
