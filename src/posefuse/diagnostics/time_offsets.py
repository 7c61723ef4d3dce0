"""How much later than they say views took their frames: all views together, once what else is wrong is granted."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from posefuse.diagnostics.clock_model import late_by
from posefuse.diagnostics.examine import Examination
from posefuse.diagnostics.hypotheses import Hypothesis, Unknown, effect_of, solve, usual_effect
from posefuse.diagnostics.linear_system import System, linearise
from posefuse.diagnostics.points import solve_points
from posefuse.diagnostics.start_offsets import amid
from posefuse.diagnostics.state import Column, State, look

_STEPS = 6
_FEWEST_SHARED = 15
"""Moments at which two views must see the same point, for their clocks to be compared."""
_WHOLE = 0.5
_STILL_S = 1e-5
_SAME = 3.0
_CERTAIN = 2.6
"""Standard deviations: by chance one clock in a hundred, and 300 ppm of a walk of a minute are mostly four."""


@dataclass(frozen=True, eq=False)
class ViewTiming:
    """When a view took its frames.

    Attributes:
        camera: its name.
        since_s: time of the view from which each row holds.
        late_s: of each row: how much later than it says, at that time.
        drift_ppm: of each row: how fast that grows.
        late_sd_s: standard deviation of an offset, in the middle of the recording.
        drift_sd_ppm: of the drift, whether there is one or not.
    """

    camera: str
    since_s: tuple[float, ...]
    late_s: tuple[float, ...]
    drift_ppm: tuple[float, ...]
    late_sd_s: float
    drift_sd_ppm: float


def time_views(examination: Examination, reference: int | None = None) -> tuple[ViewTiming, ...] | None:
    """The timing of all views that see something together; None where the views do not agree enough to tell.

    Args:
        examination: of the recording.
        reference: the view whose clock is right; by default that of most views.
    """
    if examination.fine is None:
        return None
    fine, evidence = examination.fine, examination.evidence
    clocks = _Clocks(_together(fine.last.points.weight > 0, reference), reference)
    if len(clocks.views) < 2:
        return None
    usual = usual_effect(fine.last.system, evidence.n_views, ((Column.LATE,),))
    effects = {v: _effect(fine.last.system, v, usual) for v in clocks.views}
    # Offsets first: while several views are out of step, one's offset looks like another's drift.
    state, blocks = fine.last.state, fine.last.system.block_of
    for item in fine.found:
        if item.hypothesis.kind == "drift":
            late_s = late_by(item.hypothesis, item.values)[blocks]
            state = state.with_late(item.hypothesis.view, late_s.mean() - late_s)
    state, system = _settled(examination, state, fine.last.system, set(), clocks)
    drifting = _surely_drifting(system, clocks, effects)
    if drifting:
        state, system = _settled(examination, state, system, drifting, clocks)
    every = clocks.unknowns(system, set(clocks.views))
    inverse = solve(system, every)[1]
    if reference is None:
        inverse = _about_the_mean(inverse, len(clocks.views))
        sds = np.sqrt([inverse[k, k] * effects[v] for k, v in enumerate(clocks.views)])
        late_s = state.late_s - _usual(state.late_s.mean(axis=0)[clocks.views], sds)
    else:
        late_s = state.late_s - state.late_s[:, reference][:, None]
    time_s = evidence.frame_time_s[state.frames]
    return tuple(_timing(examination, v, late_s[:, v], time_s, every, inverse, effects[v]) for v in clocks.views)


@dataclass(frozen=True)
class _Clocks:
    """Those that can be compared.

    Attributes:
        views: whose they are.
        reference: the view whose clock is right, if one is.
    """

    views: list[int]
    reference: int | None

    def unknowns(self, system: System, drifting: set[int]) -> list[Unknown]:
        """Offsets of all, and drifts of some."""
        always = np.ones(len(system.time_s))
        middle = system.time_s - system.time_s.mean()
        free = [v for v in self.views if v != self.reference]
        return [
            *(Unknown(v, Column.LATE, always) for v in free),
            *(Unknown(v, Column.LATE, middle) for v in free if v in drifting),
        ]


def _together(seen: np.ndarray, reference: int | None) -> list[int]:
    """The views that see points with each other, by way of others too: with the reference, or the most there are.

    Args:
        seen: shape (sample, column, view).
        reference: the view whose clock is right, if one is.
    """
    both = np.stack([(seen & seen[..., v : v + 1]).any(axis=1).sum(axis=0) for v in range(seen.shape[2])])
    group = connected_components(both >= _FEWEST_SHARED, directed=False)[1]
    chosen = group[reference] if reference is not None else np.argmax(np.bincount(group))
    return np.flatnonzero(group == chosen).tolist()


def _settled(
    examination: Examination, state: State, system: System, drifting: set[int], clocks: _Clocks
) -> tuple[State, System]:
    """Offsets of all views, and drifts of some, fitted together until they stay."""
    evidence, fine = examination.evidence, examination.fine
    assert fine is not None
    before = fine.last.points
    points = solve_points(evidence, state, look(evidence, state), before.scale, before.points_m)
    system = linearise(evidence, state, points, system.block_of)
    for _ in range(_STEPS):
        unknowns = clocks.unknowns(system, drifting)
        values = solve(system, unknowns)[0]
        if clocks.reference is None:
            # All clocks together could be anything: they stay where they are.
            values[: len(clocks.views)] -= values[: len(clocks.views)].mean()
        state = _moved(state, unknowns, values, system)
        points = solve_points(evidence, state, look(evidence, state), before.scale, before.points_m)
        system = linearise(evidence, state, points, system.block_of)
        if np.abs(values).max(initial=0.0) < _STILL_S:
            break
    return state, system


def _surely_drifting(system: System, clocks: _Clocks, effects: dict[int, float]) -> set[int]:
    """Views whose clock goes wrong by more than chance explains, the surest first while the others' clocks are right.

    A drift is told against all other views, which is surer than against the reference alone. If that is the one that
    goes wrong, the others drift against it.
    """
    drifting: set[int] = set()
    every = _Clocks(clocks.views, None)
    while len(drifting) < len(clocks.views) - 1:
        certain = {v: _certainty(system, every, drifting, v, effects[v]) for v in sorted(set(every.views) - drifting)}
        view = max(certain, key=lambda v: certain[v])
        if certain[view] <= _CERTAIN:
            break
        drifting.add(view)
    return set(clocks.views) - {clocks.reference} if clocks.reference in drifting else drifting


def _certainty(system: System, clocks: _Clocks, drifting: set[int], view: int, effect: float) -> float:
    """By how many standard deviations one more view drifts."""
    unknowns = clocks.unknowns(system, drifting | {view})
    values, inverse, _ = solve(system, unknowns)
    place = len(clocks.views) + sorted(drifting | {view}).index(view)
    return float(abs(values[place]) / np.sqrt(max(inverse[place, place], 1e-300) * effect))


def _usual(late_s: np.ndarray, sds: np.ndarray) -> float:
    """The offset that most views have: that of the one amid them, in the mean with those that do not differ from it."""
    away = np.abs(late_s - amid(late_s))
    near = away <= _SAME * np.hypot(sds, sds[np.argmin(away)])
    return float(np.average(late_s[near], weights=sds[near] ** -2.0))


def _about_the_mean(covariance: np.ndarray, views: int) -> np.ndarray:
    """The covariance of offsets and drifts from their means: that of all clocks together nobody can tell."""
    centred = np.eye(views) - 1.0 / views
    whole = np.zeros((2 * views, 2 * views))
    whole[:views, :views] = whole[views:, views:] = centred
    return whole @ covariance @ whole


def _moved(state: State, unknowns: list[Unknown], values: np.ndarray, system: System) -> State:
    for unknown, value in zip(unknowns, values, strict=True):
        state = state.with_late(unknown.view, value * unknown.profile[system.block_of])
    return state


def _effect(system: System, view: int, usual: float) -> float:
    one = Unknown(view, Column.LATE, np.ones(len(system.time_s)))
    values = solve(system, [one])[0]
    return effect_of(system, Hypothesis("late", view, (one,)), values, usual)


def _timing(
    examination: Examination,
    view: int,
    late: np.ndarray,
    time_s: np.ndarray,
    unknowns: list[Unknown],
    inverse: np.ndarray,
    effect: float,
) -> ViewTiming:
    sds = [np.sqrt(inverse[i, i] * effect) for i, unknown in enumerate(unknowns) if unknown.view == view] or [0.0, 0.0]
    parts = np.split(np.arange(len(late)), _jumps(examination, view))
    rows = []
    for number, part in enumerate(parts):
        slope = np.polyfit(time_s[part], late[part], 1)[0] if len(part) > 2 else 0.0
        slope = slope if abs(slope) > 1e-9 else 0.0
        # Times as the view says them: of what it lacks frames for, it says the next frame's.
        since = float(time_s[part[0]] - late[part[0]]) if number else 0.0
        at = float(late[part].mean() + slope * (since - (time_s[part] - late[part]).mean()))
        rows.append((since, at, 1e6 * float(slope)))
    since_s, late_s, drift = zip(*rows, strict=True)
    name = examination.evidence.rig.names[view]
    return ViewTiming(name, since_s, late_s, drift, float(sds[0]), 1e6 * float(sds[1]))


def _jumps(examination: Examination, view: int) -> list[int]:
    """The samples with which a view begins to lack more frames."""
    fine = examination.fine
    assert fine is not None
    blocks = fine.last.system.block_of
    steps = {
        int(np.argmax(blocks >= item.hypothesis.since))
        for item in fine.found
        if item.hypothesis.view == view
        and item.hypothesis.kind == "dropped"
        and abs(item.values[-1]) > _WHOLE * examination.evidence.period_s
    }
    return sorted(steps - {0})
