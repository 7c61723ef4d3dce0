"""How much later than they say views took their frames: all views together, once what else is wrong is granted."""

from dataclasses import dataclass

import numpy as np

from posefuse.health.examine import Examination
from posefuse.health.hypotheses import Hypothesis, Unknown, effect_of, solve, usual_effect
from posefuse.health.points import solve_points
from posefuse.health.state import Column, State, look
from posefuse.health.system import System, linearise

_STEPS = 6
_STILL_S = 1e-5
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
    """The timing of all views; None where the views do not agree enough to tell.

    Args:
        examination: of the recording.
        reference: the view whose clock is right; by default none is, and the mean offset is 0.
    """
    if examination.fine is None:
        return None
    fine, evidence = examination.fine, examination.evidence
    views = evidence.n_views
    usual = usual_effect(fine.last.system, views, ((Column.LATE,),))
    effects = [_effect(fine.last.system, v, usual) for v in range(views)]
    # Offsets first: while several views are out of step, one's offset looks like another's drift.
    state = fine.last.state
    for item in fine.found:
        if item.hypothesis.kind == "drift":
            own = state.late_s[:, item.hypothesis.view]
            state = state.with_late(item.hypothesis.view, own.mean() - own)
    state, system = _settled(examination, state, fine.last.system, set(), reference)
    drifting = _surely_drifting(system, views, reference, effects)
    if drifting:
        state, system = _settled(examination, state, system, drifting, reference)
    late = state.late_s - (state.late_s.mean() if reference is None else state.late_s[:, reference][:, None])
    every = _unknowns(system, views, set(range(views)), reference)
    inverse = _about_the_mean(solve(system, every)[1], views) if reference is None else solve(system, every)[1]
    time_s = evidence.frame_time_s[state.frames]
    return tuple(_timing(examination, v, late[:, v], time_s, every, inverse, effects[v]) for v in range(views))


def _settled(
    examination: Examination, state: State, system: System, drifting: set[int], reference: int | None
) -> tuple[State, System]:
    """Offsets of all views, and drifts of some, fitted together until they stay."""
    evidence, fine = examination.evidence, examination.fine
    assert fine is not None
    views, before = evidence.n_views, fine.last.points
    points = solve_points(evidence, state, look(evidence, state), before.scale, before.points_m)
    system = linearise(evidence, state, points, system.block_of)
    for _ in range(_STEPS):
        unknowns = _unknowns(system, views, drifting, reference)
        values = solve(system, unknowns)[0]
        if reference is None:
            # All clocks together could be anything: they stay where they are.
            values[:views] -= values[:views].mean()
        state = _moved(state, unknowns, values, system)
        points = solve_points(evidence, state, look(evidence, state), before.scale, before.points_m)
        system = linearise(evidence, state, points, system.block_of)
        if np.abs(values).max(initial=0.0) < _STILL_S:
            break
    return state, system


def _unknowns(system: System, views: int, drifting: set[int], reference: int | None) -> list[Unknown]:
    always = np.ones(len(system.time_s))
    middle = system.time_s - system.time_s.mean()
    free = [v for v in range(views) if v != reference]
    return [
        *(Unknown(v, Column.LATE, always) for v in free),
        *(Unknown(v, Column.LATE, middle) for v in free if v in drifting),
    ]


def _surely_drifting(system: System, views: int, reference: int | None, effects: list[float]) -> set[int]:
    """Views whose clock goes wrong by more than chance explains, the surest first while the others' clocks are right.

    A drift is told against all other views, which is surer than against the reference alone. If that is the one that
    goes wrong, the others drift against it.
    """
    drifting: set[int] = set()
    while len(drifting) < views - 1:
        certain = {v: _certainty(system, views, drifting, v, effects[v]) for v in set(range(views)) - drifting}
        view = max(sorted(certain), key=lambda v: certain[v])
        if certain[view] <= _CERTAIN:
            break
        drifting.add(view)
    return set(range(views)) - {reference} if reference in drifting else drifting


def _certainty(system: System, views: int, drifting: set[int], view: int, effect: float) -> float:
    """By how many standard deviations one more view drifts."""
    unknowns = _unknowns(system, views, drifting | {view}, None)
    values, inverse, _ = solve(system, unknowns)
    place = views + sorted(drifting | {view}).index(view)
    return float(abs(values[place]) / np.sqrt(max(inverse[place, place], 1e-300) * effect))


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
    edges = np.flatnonzero(np.abs(np.diff(late)) > 0.2 * examination.evidence.period_s) + 1
    parts = np.split(np.arange(len(late)), edges)
    rows = []
    for number, part in enumerate(parts):
        slope = np.polyfit(time_s[part], late[part], 1)[0] if len(part) > 2 else 0.0
        slope = slope if abs(slope) > 1e-9 else 0.0
        since = float(time_s[part[0]]) if number else 0.0
        rows.append((since, float(late[part].mean() + slope * (since - time_s[part].mean())), 1e6 * float(slope)))
    since_s, late_s, drift = zip(*rows, strict=True)
    name = examination.evidence.rig.names[view]
    return ViewTiming(name, since_s, late_s, drift, float(sds[0]), 1e6 * float(sds[1]))
