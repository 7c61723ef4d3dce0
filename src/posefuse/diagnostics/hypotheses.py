"""What may be a little wrong with one view, and how much the linearised problem says for it."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.diagnostics.linear_system import Sums, System
from posefuse.diagnostics.start_offsets import place_amid
from posefuse.diagnostics.state import N_COLUMNS, POSE, Column

_PRIOR = np.array([0.35] * 3 + [1.0] * 3 + [0.5, 0.2, 0.5, 1.0])
"""How far off each unknown is at most believed to be, one standard deviation; keeps what nothing tells at 0."""
CLOCKS = ("late", "drift", "dropped")
"""Kinds of hypotheses about when a view took its frames."""
_LEAST_BLOCKS = 3
_FEWEST_CLOCKS = 3
_POOLED = 40.0
_LEAST_FREEDOM = 0.5
_SPENT = 4.0
"""What a few seconds tell may be one posture's habit."""
_PENALTY = np.array([4.0] * 3 + [4.5] * 2 + [3.0, 3.0, 6.0, 3.0, 6.0])
"""What freeing each unknown must gain, twice the logarithm of how far off it may be over how well it is told.

Half a minute tells the aspect to 0.3 % and an offset to 5 ms, a place along the axis or a distortion term only to a
fourth or a fifth of what is usually wrong with it.
"""
_PENALTY_OF_A_MOMENT = 5.0
"""Twice the logarithm of how many moments there are: a dozen in half a minute, as neighbours are nearly the same."""
_BEYOND_CHANCE = 1.645
_KINDS = (POSE, (Column.FOCAL,), (Column.LATE,))


@dataclass(frozen=True, eq=False)
class Unknown:
    """A number that may differ from what is believed.

    Attributes:
        view: of the view.
        column: which of its numbers.
        profile: shape (block,): by how much of it each block is off.
    """

    view: int
    column: Column
    profile: np.ndarray

    @property
    def index(self) -> int:
        """Its place among the unknowns of a system."""
        return self.view * N_COLUMNS + self.column


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Something that may be wrong.

    Attributes:
        kind: ``pose``, ``along``, ``across``, ``turn``, ``focal``, ``lens``, ``aspect``, ``late``, ``drift``,
            ``dropped``.
        view: of the view.
        unknowns: that it frees.
        since: the block from which on it holds, or None where it always does.
    """

    kind: str
    view: int
    unknowns: tuple[Unknown, ...]
    since: int | None = None

    @property
    def penalty(self) -> float:
        """What it must gain to be as good as nothing."""
        moment = _PENALTY_OF_A_MOMENT if self.since is not None else 0.0
        return float(_PENALTY[[unknown.column for unknown in self.unknowns]].sum()) + moment


@dataclass(frozen=True, eq=False)
class Verdict:
    """What the data say of a hypothesis.

    Attributes:
        hypothesis: which.
        gain: twice the gain in log-likelihood, for as many observations as are independent; about chi-square where
            nothing is wrong.
        values: shape (unknown,): of the hypothesis.
        sds: shape (unknown,): their standard deviations.
        effect: how many observations count as one.
        raw: the gain as if all observations were independent.
    """

    hypothesis: Hypothesis
    gain: float
    values: np.ndarray
    sds: np.ndarray
    effect: float
    raw: float

    @property
    def score(self) -> float:
        """The gain less the penalty."""
        return self.gain - self.hypothesis.penalty


def hypotheses(system: System, view: int, free: Sequence[str]) -> Iterator[Hypothesis]:
    """Everything that may be wrong with a view, of the given kinds."""
    blocks = len(system.time_s)
    always = np.ones(blocks)
    middle = system.time_s - system.time_s.mean()

    def make(kind: str, *parts: tuple[Column, np.ndarray], since: int | None = None) -> Hypothesis:
        return Hypothesis(kind, view, tuple(Unknown(view, *part) for part in parts), since)

    pose = [Column(c) for c in POSE]
    if "pose" in free:
        yield make("along", (Column.SHIFT_Z, always))
        yield make("across", *((c, always) for c in (Column.SHIFT_X, Column.SHIFT_Y)))
        yield make("turn", *((c, always) for c in pose[:3]))
        yield make("pose", *((c, always) for c in pose))
    if "lens" in free:
        yield make("focal", (Column.FOCAL, always))
        yield make("lens", (Column.BEND, always))
        yield make("lens", (Column.FOCAL, always), (Column.BEND, always))
        yield make("aspect", (Column.ASPECT, always))
    if "late" in free:
        yield make("late", (Column.LATE, always))
        yield make("drift", (Column.LATE, system.time_s - system.time_s[0]))
        yield make("drift", (Column.LATE, always), (Column.LATE, middle))
        yield drift_alone(system, view)
    for since in range(_LEAST_BLOCKS, blocks - _LEAST_BLOCKS + 1):
        later = (np.arange(blocks) >= since).astype(float)
        if "pose" in free:
            yield make("along", (Column.SHIFT_Z, later), since=since)
            yield make("across", *((c, later) for c in (Column.SHIFT_X, Column.SHIFT_Y)), since=since)
            yield make("turn", *((c, later) for c in pose[:3]), since=since)
            yield make("pose", *((c, later) for c in pose), since=since)
        if "late" in free:
            yield make("dropped", (Column.LATE, later), since=since)
            yield make("dropped", (Column.LATE, always), (Column.LATE, later), since=since)


def drift_alone(system: System, view: int) -> Hypothesis:
    """A clock that drifts and is right in the middle of the recording."""
    return Hypothesis("drift", view, (Unknown(view, Column.LATE, system.time_s - system.time_s.mean()),))


def promising(
    system: System, accepted: Sequence[Unknown], every: Iterable[Hypothesis], usual_effect: float
) -> Iterator[Hypothesis]:
    """Those that could be worth their penalty if the scatter were as small as it can be; most are not."""
    before = solve(system, accepted)[2] if accepted else 0.0
    for group in _alike(every):
        for one, gain in zip(group, _gains(system, accepted, group), strict=True):
            raw = max(float(gain) - before, 0.0) / _least_effect(system, one, usual_effect)
            if told(system, raw) > one.penalty:
                yield one


def _alike(every: Iterable[Hypothesis]) -> Iterable[list[Hypothesis]]:
    """Hypotheses about the same numbers, from one moment on or another."""
    groups: dict[tuple[int, ...], list[Hypothesis]] = {}
    for one in every:
        groups.setdefault(tuple(unknown.index for unknown in one.unknowns), []).append(one)
    return groups.values()


def _gains(system: System, accepted: Sequence[Unknown], group: Sequence[Hypothesis]) -> np.ndarray:
    """Shape (hypothesis,): what :func:`solve` gains with each of several hypotheses about the same numbers."""
    index = [unknown.index for unknown in (*accepted, *group[0].unknowns)]
    profile = np.stack([np.stack([u.profile for u in (*accepted, *one.unknowns)]) for one in group])
    normal = np.moveaxis(system.blocks.normal[:, index][:, :, index], 0, -1)
    whole = (profile[:, :, None] * profile[:, None] * normal).sum(axis=-1)
    total = (profile * system.blocks.right[:, index].T).sum(axis=-1)
    columns = [unknown.column for unknown in (*accepted, *group[0].unknowns)]
    prior = _PRIOR[columns] / np.maximum(np.abs(profile).max(axis=-1), 1e-9)
    values = np.linalg.solve(whole + np.eye(len(index)) * prior[:, None, :] ** -2.0, total[..., None])[..., 0]
    return (total * values).sum(axis=-1)


def told(system: System, raw: float) -> float:
    """What a likelihood ratio is worth whose variance is known from so many clusters only: it grows more slowly."""
    freedom = max(independent(system) - _SPENT, _LEAST_FREEDOM)
    return freedom * float(np.log1p(raw / freedom))


def reduced(sums: Sums, unknowns: Sequence[Unknown]) -> tuple[np.ndarray, np.ndarray]:
    """The equations of some unknowns by block: shapes (block, unknown, unknown) and (block, unknown)."""
    index = [unknown.index for unknown in unknowns]
    profile = np.stack([unknown.profile for unknown in unknowns], axis=1)
    normal = sums.normal[:, index][:, :, index] * profile[:, :, None] * profile[:, None, :]
    return normal, sums.right[:, index] * profile


def solve(system: System, unknowns: Sequence[Unknown]) -> tuple[np.ndarray, np.ndarray, float]:
    """The best values of some unknowns, the inverse of their normal equations, and the gain, for all observations."""
    normal, right = reduced(system.blocks, unknowns)
    whole, total = normal.sum(axis=0), right.sum(axis=0)
    prior = np.array([_PRIOR[unknown.column] * _reach(unknown) for unknown in unknowns])
    inverse = np.linalg.inv(whole + np.diag(prior**-2.0))
    values = inverse @ total
    return values, inverse, float(total @ values)


def _reach(unknown: Unknown) -> float:
    # A drift's profile is seconds: by its prior the ends are at most a second off.
    return 1.0 / max(float(np.abs(unknown.profile).max()), 1e-9)


def judge(system: System, accepted: Sequence[Unknown], hypothesis: Hypothesis, usual_effect: float) -> Verdict:
    """What the data say for a hypothesis beyond what is accepted already."""
    both = (*accepted, *hypothesis.unknowns)
    values, inverse, gain = solve(system, both)
    before = solve(system, accepted)[2] if accepted else 0.0
    n, raw = len(accepted), max(gain - before, 0.0)
    effect = effect_of(system, hypothesis, values[n:], usual_effect)
    sds = np.sqrt(np.maximum(np.diag(inverse)[n:], 0.0) * effect)
    return Verdict(hypothesis, told(system, raw / effect), values[n:], sds, effect, raw)


def offsets_of_all(system: System, views: int, usual: float) -> Verdict | None:
    """What the data say for clocks of which each is off by something of its own.

    All views but the one amid the others: where most agree, that is one of them.
    """
    free = [Unknown(v, Column.LATE, np.ones(len(system.time_s))) for v in range(views) if system.seen[v] > 0]
    if len(free) < _FEWEST_CLOCKS:
        return None
    late_s = solve(system, free)[0]
    middle = place_amid(late_s)
    others = tuple(unknown for k, unknown in enumerate(free) if k != middle)
    return judge(system, (), Hypothesis("late", free[middle].view, others), usual)


def independent(system: System) -> float:
    """How many independent numbers there are: two for each column or second, whichever are fewer.

    Errors last for about a second, and each has two axes.
    """
    return 2.0 * min(float(len(system.columns.right)), system.lasts_s)


def effect_of(system: System, hypothesis: Hypothesis, values: np.ndarray, usual: float) -> float:
    """How many observations count as one: by the scatter of blocks of time and of columns about the answer.

    A scatter is known the better the more clusters there are; what is usual counts as so many clusters more. Where
    columns scatter more than is usual by more than chance explains, keypoints have habits: it is taken as it is.
    """
    normal, right = reduced(system.blocks, hypothesis.unknowns)
    by_time, freedom = _scatter(normal, right, values)
    plain = {unknown.index: unknown for unknown in hypothesis.unknowns}
    index = [unknown.index for unknown in plain.values()]
    by_column, more = _scatter(system.columns.normal[:, index][:, :, index], system.columns.right[:, index], None)
    time_effect = (by_time * freedom + usual * _POOLED) / (freedom + _POOLED)
    column_effect = (by_column * more + usual * _POOLED) / (more + _POOLED)
    habits = by_column > usual * (1.0 + _BEYOND_CHANCE * np.sqrt(2.0 / max(more, 1.0)))
    return max(time_effect, by_column if habits else column_effect, 1.0)


def _least_effect(system: System, hypothesis: Hypothesis, usual: float) -> float:
    """What :func:`effect_of` is at least."""
    most = (len(system.time_s) - 1) * len(hypothesis.unknowns)
    return max(usual * _POOLED / (most + _POOLED), 1.0)


def _scatter(normal: np.ndarray, right: np.ndarray, values: np.ndarray | None) -> tuple[float, float]:
    """The mean squared score of clusters about the common answer, in units of the noise, and its freedom."""
    whole = normal.sum(axis=0)
    size = len(whole)
    ridge = 1e-9 * np.trace(whole) / size * np.eye(size) + 1e-12 * np.eye(size)
    if values is None:
        values = np.linalg.solve(whole + ridge, right.sum(axis=0))
    left = right - normal @ values
    telling = np.trace(normal, axis1=-2, axis2=-1) > 1e-3 * np.trace(whole) / max(len(normal), 1)
    clusters = int(telling.sum())
    if clusters < 3:
        return 1.0, 0.0
    lower = np.linalg.cholesky(whole + ridge)
    scores = np.linalg.solve(lower, left[telling].T)
    return float(np.square(scores).sum()) / size * clusters / (clusters - 1), float((clusters - 1) * size)


def usual_effect(system: System, views: int, kinds: Sequence[Sequence[int]] = _KINDS) -> float:
    """The median over views and kinds of unknowns of how many observations count as one, by blocks or by columns."""
    by_time, by_column = [], []
    always = np.ones(len(system.time_s))
    for view in range(views):
        for columns in kinds:
            free = [Unknown(view, Column(c), always) for c in columns]
            values = solve(system, free)[0]
            normal, right = reduced(system.blocks, free)
            by_time.append(_scatter(normal, right, values)[0])
            index = [unknown.index for unknown in free]
            sums = system.columns
            by_column.append(_scatter(sums.normal[:, index][:, :, index], sums.right[:, index], None)[0])
    return max(float(np.median(by_time)), float(np.median(by_column)), 1.0)
