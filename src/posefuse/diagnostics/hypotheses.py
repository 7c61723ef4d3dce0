"""Hypotheses about small faults of single views, and their evaluation by the linearized problem."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.diagnostics.linear_system import LinearSystem, NormalEquations
from posefuse.diagnostics.recording_model import N_PARAMETERS, POSE_PARAMETERS, Parameter
from posefuse.diagnostics.start_offsets import medoid_index

_PRIOR = np.array([0.35] * 3 + [1.0] * 3 + [0.5, 0.2, 0.5, 1.0])
"""Prior standard deviation of each parameter; keeps parameters near 0 that the data do not determine."""
CLOCK_KINDS = ("offset", "drift", "dropped")
"""Kinds of hypotheses about a view's clock."""
_MIN_BLOCKS = 3
_MIN_CLOCKS = 3
_PRIOR_CLUSTERS = 40.0
_MIN_DOF = 0.5
_SPENT_DOF = 4.0
"""Degrees of freedom withheld, because a few seconds may reflect one posture only."""
_PENALTY = np.array([4.0] * 3 + [4.5] * 2 + [3.0, 3.0, 6.0, 3.0, 6.0])
"""Required gain of each parameter, in units of twice the log-likelihood.

It is twice the logarithm of the prior range divided by the precision with which the data determine the parameter: half
a minute determines the aspect ratio to 0.3 % and a time offset to 5 ms, but a shift along the optical axis or a
distortion coefficient only to a fourth or fifth of its usual error.
"""
_CHANGE_POINT_PENALTY = 5.0
"""Penalty for choosing a change point: twice the logarithm of about a dozen distinguishable times in half a minute."""
_SIGNIFICANT_Z = 1.645
_PARAMETER_GROUPS = (POSE_PARAMETERS, (Parameter.FOCAL,), (Parameter.OFFSET,))


@dataclass(frozen=True, eq=False)
class Unknown:
    """Describe one parameter correction with its profile over time.

    Attributes:
        view: index of the view.
        parameter: parameter of the view.
        profile: shape (block,): factor of the correction in each block.
    """

    view: int
    parameter: Parameter
    profile: np.ndarray

    @property
    def index(self) -> int:
        """Return the index of the parameter in a :class:`~posefuse.diagnostics.linear_system.LinearSystem`."""
        return self.view * N_PARAMETERS + self.parameter


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Describe one possible fault of one view.

    Attributes:
        kind: ``pose``, ``axial`` (shift along the optical axis), ``lateral`` (shift across it), ``rotation``,
            ``focal``, ``distortion``, ``aspect``, ``offset``, ``drift`` or ``dropped``.
        view: index of the view.
        unknowns: parameters it frees.
        since_block: first block of the fault, or None if it is always present.
    """

    kind: str
    view: int
    unknowns: tuple[Unknown, ...]
    since_block: int | None = None

    @property
    def penalty(self) -> float:
        """Return the gain that the hypothesis must exceed."""
        change_point = _CHANGE_POINT_PENALTY if self.since_block is not None else 0.0
        return float(_PENALTY[[unknown.parameter for unknown in self.unknowns]].sum()) + change_point


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Hold the support of the data for one hypothesis.

    Attributes:
        hypothesis: the hypothesis.
        gain: twice the gain in log-likelihood, corrected for correlated observations; about chi-square if there is no
            fault.
        values: shape (unknown,): estimated values.
        sds: shape (unknown,): their standard deviations.
        design_effect: number of correlated observations that carry the information of one.
        raw_gain: gain if all observations were independent.
    """

    hypothesis: Hypothesis
    gain: float
    values: np.ndarray
    sds: np.ndarray
    design_effect: float
    raw_gain: float

    @property
    def score(self) -> float:
        """Return the gain minus the penalty."""
        return self.gain - self.hypothesis.penalty


def enumerate_hypotheses(system: LinearSystem, view: int, groups: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield all hypotheses about one view.

    Args:
        system: linearized problem; sets the number of blocks.
        view: index of the view.
        groups: any of ``pose``, ``lens`` and ``clock``.
    """
    blocks = len(system.time_s)
    always = np.ones(blocks)
    middle = system.time_s - system.time_s.mean()

    def make(kind: str, *parts: tuple[Parameter, np.ndarray], since_block: int | None = None) -> Hypothesis:
        return Hypothesis(kind, view, tuple(Unknown(view, *part) for part in parts), since_block)

    pose = [Parameter(c) for c in POSE_PARAMETERS]
    if "pose" in groups:
        yield make("axial", (Parameter.TRANSLATION_Z, always))
        yield make("lateral", *((c, always) for c in (Parameter.TRANSLATION_X, Parameter.TRANSLATION_Y)))
        yield make("rotation", *((c, always) for c in pose[:3]))
        yield make("pose", *((c, always) for c in pose))
    if "lens" in groups:
        yield make("focal", (Parameter.FOCAL, always))
        yield make("distortion", (Parameter.K1, always))
        yield make("distortion", (Parameter.FOCAL, always), (Parameter.K1, always))
        yield make("aspect", (Parameter.ASPECT, always))
    if "clock" in groups:
        yield make("offset", (Parameter.OFFSET, always))
        yield make("drift", (Parameter.OFFSET, system.time_s - system.time_s[0]))
        yield make("drift", (Parameter.OFFSET, always), (Parameter.OFFSET, middle))
        yield centered_drift(system, view)
    for first in range(_MIN_BLOCKS, blocks - _MIN_BLOCKS + 1):
        later = (np.arange(blocks) >= first).astype(float)
        if "pose" in groups:
            yield make("axial", (Parameter.TRANSLATION_Z, later), since_block=first)
            yield make(
                "lateral", *((c, later) for c in (Parameter.TRANSLATION_X, Parameter.TRANSLATION_Y)), since_block=first
            )
            yield make("rotation", *((c, later) for c in pose[:3]), since_block=first)
            yield make("pose", *((c, later) for c in pose), since_block=first)
        if "clock" in groups:
            yield make("dropped", (Parameter.OFFSET, later), since_block=first)
            yield make("dropped", (Parameter.OFFSET, always), (Parameter.OFFSET, later), since_block=first)


def centered_drift(system: LinearSystem, view: int) -> Hypothesis:
    """Return the hypothesis of a clock drift that is zero in the middle of the recording."""
    return Hypothesis("drift", view, (Unknown(view, Parameter.OFFSET, system.time_s - system.time_s.mean()),))


def promising_hypotheses(
    system: LinearSystem, accepted: Sequence[Unknown], candidates: Iterable[Hypothesis], typical_design_effect: float
) -> Iterator[Hypothesis]:
    """Yield the hypotheses that would exceed their penalty at the smallest possible design effect."""
    before = solve_unknowns(system, accepted)[2] if accepted else 0.0
    for group in _group_by_unknowns(candidates):
        for one, gain in zip(group, _gains(system, accepted, group), strict=True):
            raw_gain = max(float(gain) - before, 0.0) / _min_design_effect(system, one, typical_design_effect)
            if effective_gain(system, raw_gain) > one.penalty:
                yield one


def _group_by_unknowns(candidates: Iterable[Hypothesis]) -> Iterable[list[Hypothesis]]:
    """Group hypotheses that free the same parameters and differ in their profiles only."""
    groups: dict[tuple[int, ...], list[Hypothesis]] = {}
    for one in candidates:
        groups.setdefault(tuple(unknown.index for unknown in one.unknowns), []).append(one)
    return groups.values()


def _gains(system: LinearSystem, accepted: Sequence[Unknown], group: Sequence[Hypothesis]) -> np.ndarray:
    """Return the gain of :func:`solve_unknowns` for hypotheses about the same parameters, shape (hypothesis,).

    The equations of the accepted unknowns are the same for all hypotheses; only those that contain a hypothesis' own
    unknowns are summed per hypothesis.
    """
    normal, right, n = system.blocks.normal, system.blocks.right, len(accepted)
    old, new = [unknown.index for unknown in accepted], [unknown.index for unknown in group[0].unknowns]
    size = n + len(new)
    profiles = np.array([[unknown.profile for unknown in one.unknowns] for one in group])
    whole, total = np.empty((len(group), size, size)), np.empty((len(group), size))
    inverse_reach = np.empty((len(group), size))
    inverse_reach[:, n:] = 1.0 / np.maximum(np.abs(profiles).max(axis=-1), 1e-9)
    if n:
        equations, sums = restrict(system.blocks, accepted)
        whole[:, :n, :n], total[:, :n] = equations.sum(axis=0), sums.sum(axis=0)
        inverse_reach[:, :n] = [_inverse_reach(unknown) for unknown in accepted]
    by_block = np.array([unknown.profile for unknown in accepted]).T
    for k, index in enumerate(new):
        total[:, n + k] = profiles[:, k] @ right[:, index]
        if n:
            whole[:, n + k, :n] = whole[:, :n, n + k] = profiles[:, k] @ (normal[:, old, index] * by_block)
        for other in range(k + 1):
            both = (profiles[:, k] * profiles[:, other]) @ normal[:, index, new[other]]
            whole[:, n + k, n + other] = whole[:, n + other, n + k] = both
    prior = _PRIOR[[unknown.parameter for unknown in (*accepted, *group[0].unknowns)]] * inverse_reach
    values = np.linalg.solve(whole + np.eye(size) * prior[:, None, :] ** -2.0, total[..., None])[..., 0]
    return (total * values).sum(axis=-1)


def effective_gain(system: LinearSystem, raw_gain: float) -> float:
    """Return the gain adjusted for a variance estimated from few clusters; it grows logarithmically."""
    dof = max(n_independent(system) - _SPENT_DOF, _MIN_DOF)
    return dof * float(np.log1p(raw_gain / dof))


def restrict(sums: NormalEquations, unknowns: Sequence[Unknown]) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations of some unknowns per block, shapes (block, unknown, unknown) and (block, unknown)."""
    index = [unknown.index for unknown in unknowns]
    profile = np.stack([unknown.profile for unknown in unknowns], axis=1)
    normal = sums.normal[:, index][:, :, index] * profile[:, :, None] * profile[:, None, :]
    return normal, sums.right[:, index] * profile


def solve_unknowns(system: LinearSystem, unknowns: Sequence[Unknown]) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the best values of some unknowns, the inverse of their normal equations, and the raw gain."""
    normal, right = restrict(system.blocks, unknowns)
    whole, total = normal.sum(axis=0), right.sum(axis=0)
    prior = np.array([_PRIOR[unknown.parameter] * _inverse_reach(unknown) for unknown in unknowns])
    inverse = np.linalg.inv(whole + np.diag(prior**-2.0))
    values = inverse @ total
    return values, inverse, float(total @ values)


def _inverse_reach(unknown: Unknown) -> float:
    """Scale the prior by the largest factor of the profile; a drift's profile is in seconds."""
    # The profile of a drift is in seconds: the prior then bounds the offset at the ends to about a second.
    return 1.0 / max(float(np.abs(unknown.profile).max()), 1e-9)


def evaluate(
    system: LinearSystem, accepted: Sequence[Unknown], hypothesis: Hypothesis, typical_design_effect: float
) -> Evaluation:
    """Evaluate one hypothesis beyond what is accepted already."""
    both = (*accepted, *hypothesis.unknowns)
    values, inverse, gain = solve_unknowns(system, both)
    before = solve_unknowns(system, accepted)[2] if accepted else 0.0
    n, raw_gain = len(accepted), max(gain - before, 0.0)
    effect = design_effect_of(system, hypothesis, values[n:], typical_design_effect)
    sds = np.sqrt(np.maximum(np.diag(inverse)[n:], 0.0) * effect)
    return Evaluation(hypothesis, effective_gain(system, raw_gain / effect), values[n:], sds, effect, raw_gain)


def evaluate_all_offsets(system: LinearSystem, views: int, typical: float) -> Evaluation | None:
    """Evaluate the hypothesis that every clock has its own offset.

    The view with the medoid offset is the reference: where most clocks agree, it is one of them.
    """
    free = [Unknown(v, Parameter.OFFSET, np.ones(len(system.time_s))) for v in range(views) if system.n_checked[v] > 0]
    if len(free) < _MIN_CLOCKS:
        return None
    offsets_s = solve_unknowns(system, free)[0]
    middle = medoid_index(offsets_s)
    others = tuple(unknown for k, unknown in enumerate(free) if k != middle)
    return evaluate(system, (), Hypothesis("offset", free[middle].view, others), typical)


def n_independent(system: LinearSystem) -> float:
    """Return the number of independent measurements: two per column or per second, whichever are fewer.

    Errors are correlated for about a second and have two axes.
    """
    return 2.0 * min(float(len(system.columns.right)), system.duration_s)


def design_effect_of(system: LinearSystem, hypothesis: Hypothesis, values: np.ndarray, typical: float) -> float:
    """Estimate the design effect of a hypothesis from the scatter of blocks and of columns about the solution.

    The more clusters, the better the scatter is known; the typical design effect enters as a prior worth a fixed number
    of clusters. If columns scatter significantly more than is typical, keypoints have systematic errors, and their
    scatter is used directly.
    """
    normal, right = restrict(system.blocks, hypothesis.unknowns)
    by_time, time_dof = _scatter(normal, right, values)
    distinct = {unknown.index: unknown for unknown in hypothesis.unknowns}
    index = [unknown.index for unknown in distinct.values()]
    by_column, column_dof = _scatter(system.columns.normal[:, index][:, :, index], system.columns.right[:, index], None)
    time_effect = (by_time * time_dof + typical * _PRIOR_CLUSTERS) / (time_dof + _PRIOR_CLUSTERS)
    column_effect = (by_column * column_dof + typical * _PRIOR_CLUSTERS) / (column_dof + _PRIOR_CLUSTERS)
    systematic = by_column > typical * (1.0 + _SIGNIFICANT_Z * np.sqrt(2.0 / max(column_dof, 1.0)))
    return max(time_effect, by_column if systematic else column_effect, 1.0)


def _min_design_effect(system: LinearSystem, hypothesis: Hypothesis, typical: float) -> float:
    """Return a lower bound of :func:`design_effect_of`."""
    most = (len(system.time_s) - 1) * len(hypothesis.unknowns)
    return max(typical * _PRIOR_CLUSTERS / (most + _PRIOR_CLUSTERS), 1.0)


def _scatter(normal: np.ndarray, right: np.ndarray, values: np.ndarray | None) -> tuple[float, float]:
    """Return the mean squared score of clusters about the common solution, and its degrees of freedom.

    Scores are in units of the noise.
    """
    whole = normal.sum(axis=0)
    size = len(whole)
    ridge = 1e-9 * np.trace(whole) / size * np.eye(size) + 1e-12 * np.eye(size)
    if values is None:
        values = np.linalg.solve(whole + ridge, right.sum(axis=0))
    remainder = right - normal @ values
    informative = np.trace(normal, axis1=-2, axis2=-1) > 1e-3 * np.trace(whole) / max(len(normal), 1)
    clusters = int(informative.sum())
    if clusters < 3:
        return 1.0, 0.0
    lower = np.linalg.cholesky(whole + ridge)
    scores = np.linalg.solve(lower, remainder[informative].T)
    return float(np.square(scores).sum()) / size * clusters / (clusters - 1), float((clusters - 1) * size)


def typical_design_effect(
    system: LinearSystem, views: int, groups: Sequence[Sequence[int]] = _PARAMETER_GROUPS
) -> float:
    """Return the median design effect over views and kinds of parameters.

    Of the medians by blocks and by columns the larger one counts.
    """
    by_time, by_column = [], []
    always = np.ones(len(system.time_s))
    for view in range(views):
        for parameters in groups:
            free = [Unknown(view, Parameter(p), always) for p in parameters]
            values = solve_unknowns(system, free)[0]
            normal, right = restrict(system.blocks, free)
            by_time.append(_scatter(normal, right, values)[0])
            index = [unknown.index for unknown in free]
            sums = system.columns
            by_column.append(_scatter(sums.normal[:, index][:, :, index], sums.right[:, index], None)[0])
    return max(float(np.median(by_time)), float(np.median(by_column)), 1.0)


def best_of_each(evaluations: Sequence[Evaluation]) -> list[Evaluation]:
    """Return the best evaluation of each view and kind."""
    seen: dict[tuple[int, str], Evaluation] = {}
    for evaluation in evaluations:
        seen.setdefault((evaluation.hypothesis.view, evaluation.hypothesis.kind), evaluation)
    return list(seen.values())
