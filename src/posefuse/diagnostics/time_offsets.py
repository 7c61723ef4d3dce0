"""Measure the time offsets and clock drifts of all views jointly, after correcting all other faults."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from posefuse.diagnostics.clock_model import clock_offset_s
from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.hypotheses import Hypothesis, Unknown, design_effect_of, solve_unknowns, typical_design_effect
from posefuse.diagnostics.linear_system import LinearSystem, linearize
from posefuse.diagnostics.normalized_views import normalize_views
from posefuse.diagnostics.recording_model import Parameter, RecordingModel
from posefuse.diagnostics.sample_points import triangulate_samples
from posefuse.diagnostics.start_offsets import medoid

_MAX_STEPS = 6
_MIN_SHARED_SAMPLES = 15
"""Samples at which two views must see the same point for their clocks to be compared."""
_MIN_DROPPED_FRAMES = 0.5
_CONVERGED_S = 1e-5
_EQUAL_Z = 3.0
_DRIFT_Z = 2.6
"""Standard deviations required of a drift: one false drift in a hundred clocks; most drifts of 300 ppm exceed it in a
minute of walking.
"""


@dataclass(frozen=True, eq=False)
class ViewTiming:
    """Hold the timing of one view.

    Attributes:
        camera: name of the camera.
        start_s: timestamp of the view from which each row holds.
        offset_s: of each row: true time minus timestamp, at ``start_s``.
        drift_ppm: of each row: rate of change of the offset, in parts per million.
        offset_sd_s: standard deviation of the offset, in the middle of the recording.
        drift_sd_ppm: standard deviation of the drift, whether or not a drift was found.
    """

    camera: str
    start_s: tuple[float, ...]
    offset_s: tuple[float, ...]
    drift_ppm: tuple[float, ...]
    offset_sd_s: float
    drift_sd_ppm: float


def time_views(examination: Examination, reference: int | None = None) -> tuple[ViewTiming, ...] | None:
    """Return the timing of all connected views, or None if the views do not agree well enough.

    Args:
        examination: of the recording.
        reference: index of the view with the reference clock; by default the clock that most views share.
    """
    if examination.fine is None:
        return None
    fine, observations = examination.fine, examination.observations
    clock_unknowns = _ClockUnknowns(_connected_views(fine.final.points.weight > 0, reference), reference)
    if len(clock_unknowns.views) < 2:
        return None
    typical = typical_design_effect(fine.final.system, observations.n_views, ((Parameter.OFFSET,),))
    effects = {v: _offset_design_effect(fine.final.system, v, typical) for v in clock_unknowns.views}
    # Fit offsets first: while several views are unsynchronized, one view's offset resembles another's drift.
    model, blocks = fine.final.model, fine.final.system.block_index
    for fault in fine.accepted:
        if fault.hypothesis.kind == "drift":
            offset_s = clock_offset_s(fault.hypothesis, fault.values)[blocks]
            model = model.with_offset(fault.hypothesis.view, offset_s.mean() - offset_s)
    model, system = _fit_jointly(examination, model, fine.final.system, set(), clock_unknowns)
    drifting = _drifting_views(system, clock_unknowns, effects)
    if drifting:
        model, system = _fit_jointly(examination, model, system, drifting, clock_unknowns)
    every = clock_unknowns.unknowns(system, set(clock_unknowns.views))
    inverse = solve_unknowns(system, every)[1]
    if reference is None:
        inverse = _centered_covariance(inverse, len(clock_unknowns.views))
        sds = np.sqrt([inverse[k, k] * effects[v] for k, v in enumerate(clock_unknowns.views)])
        offset_s = model.offset_s - _common_offset(model.offset_s.mean(axis=0)[clock_unknowns.views], sds)
    else:
        offset_s = model.offset_s - model.offset_s[:, reference][:, None]
    time_s = observations.frame_time_s[model.frames]
    return tuple(
        _view_timing(examination, v, offset_s[:, v], time_s, every, inverse, effects[v]) for v in clock_unknowns.views
    )


@dataclass(frozen=True)
class _ClockUnknowns:
    """Select the clock parameters to estimate.

    Attributes:
        views: views whose clocks can be compared.
        reference: index of the view with the reference clock, or None.
    """

    views: list[int]
    reference: int | None

    def unknowns(self, system: LinearSystem, drifting: set[int]) -> list[Unknown]:
        """Return the offsets of all views and the drifts of some."""
        always = np.ones(len(system.time_s))
        middle = system.time_s - system.time_s.mean()
        free = [v for v in self.views if v != self.reference]
        return [
            *(Unknown(v, Parameter.OFFSET, always) for v in free),
            *(Unknown(v, Parameter.OFFSET, middle) for v in free if v in drifting),
        ]


def _connected_views(seen: np.ndarray, reference: int | None) -> list[int]:
    """Return the views connected by shared points: with the reference, or the largest group.

    Args:
        seen: shape (sample, column, view).
        reference: index of the view with the reference clock, or None.
    """
    both = np.stack([(seen & seen[..., v : v + 1]).any(axis=1).sum(axis=0) for v in range(seen.shape[2])])
    group = connected_components(both >= _MIN_SHARED_SAMPLES, directed=False)[1]
    chosen = group[reference] if reference is not None else np.argmax(np.bincount(group))
    return np.flatnonzero(group == chosen).tolist()


def _fit_jointly(
    examination: Examination,
    model: RecordingModel,
    system: LinearSystem,
    drifting: set[int],
    clock_unknowns: _ClockUnknowns,
) -> tuple[RecordingModel, LinearSystem]:
    """Fit the offsets of all views and the drifts of some together until they converge."""
    observations, fine = examination.observations, examination.fine
    assert fine is not None
    previous = fine.final.points
    points = triangulate_samples(
        observations, model, normalize_views(observations, model), previous.noise_scale, previous.points_m
    )
    system = linearize(observations, model, points, system.block_index)
    for _ in range(_MAX_STEPS):
        unknowns = clock_unknowns.unknowns(system, drifting)
        values = solve_unknowns(system, unknowns)[0]
        if clock_unknowns.reference is None:
            # The common offset of all clocks is unobservable: keep it unchanged.
            values[: len(clock_unknowns.views)] -= values[: len(clock_unknowns.views)].mean()
        model = _shifted(model, unknowns, values, system)
        points = triangulate_samples(
            observations, model, normalize_views(observations, model), previous.noise_scale, previous.points_m
        )
        system = linearize(observations, model, points, system.block_index)
        if np.abs(values).max(initial=0.0) < _CONVERGED_S:
            break
    return model, system


def _drifting_views(system: LinearSystem, clock_unknowns: _ClockUnknowns, effects: dict[int, float]) -> set[int]:
    """Return the views with significant drift, selected stepwise, the most significant first.

    A drift is measured against all other views, which is more certain than against the reference alone. If the
    reference itself drifts, all others drift against it.
    """
    drifting: set[int] = set()
    every = _ClockUnknowns(clock_unknowns.views, None)
    while len(drifting) < len(clock_unknowns.views) - 1:
        z_scores = {v: _drift_z(system, every, drifting, v, effects[v]) for v in sorted(set(every.views) - drifting)}
        view = max(z_scores, key=lambda v: z_scores[v])
        if z_scores[view] <= _DRIFT_Z:
            break
        drifting.add(view)
    return set(clock_unknowns.views) - {clock_unknowns.reference} if clock_unknowns.reference in drifting else drifting


def _drift_z(
    system: LinearSystem, clock_unknowns: _ClockUnknowns, drifting: set[int], view: int, effect: float
) -> float:
    """Return the drift of one more view in standard deviations."""
    unknowns = clock_unknowns.unknowns(system, drifting | {view})
    values, inverse, _ = solve_unknowns(system, unknowns)
    place = len(clock_unknowns.views) + sorted(drifting | {view}).index(view)
    return float(abs(values[place]) / np.sqrt(max(inverse[place, place], 1e-300) * effect))


def _common_offset(offset_s: np.ndarray, sds: np.ndarray) -> float:
    """Return the offset that most views share: the medoid, averaged with the offsets that do not differ from it."""
    away = np.abs(offset_s - medoid(offset_s))
    near = away <= _EQUAL_Z * np.hypot(sds, sds[np.argmin(away)])
    return float(np.average(offset_s[near], weights=sds[near] ** -2.0))


def _centered_covariance(covariance: np.ndarray, views: int) -> np.ndarray:
    """Return the covariance of offsets and drifts about their means; their common value is unobservable."""
    centering = np.eye(views) - 1.0 / views
    projection = np.zeros((2 * views, 2 * views))
    projection[:views, :views] = projection[views:, views:] = centering
    return projection @ covariance @ projection


def _shifted(
    model: RecordingModel, unknowns: list[Unknown], values: np.ndarray, system: LinearSystem
) -> RecordingModel:
    """Apply the values of clock unknowns to a model."""
    for unknown, value in zip(unknowns, values, strict=True):
        model = model.with_offset(unknown.view, value * unknown.profile[system.block_index])
    return model


def _offset_design_effect(system: LinearSystem, view: int, typical: float) -> float:
    """Return the design effect of a view's time offset."""
    one = Unknown(view, Parameter.OFFSET, np.ones(len(system.time_s)))
    values = solve_unknowns(system, [one])[0]
    return design_effect_of(system, Hypothesis("offset", view, (one,)), values, typical)


def _view_timing(
    examination: Examination,
    view: int,
    offsets_s: np.ndarray,
    time_s: np.ndarray,
    unknowns: list[Unknown],
    inverse: np.ndarray,
    effect: float,
) -> ViewTiming:
    """Return the timing of one view, with one row per run without dropped frames."""
    sds = [np.sqrt(inverse[i, i] * effect) for i, unknown in enumerate(unknowns) if unknown.view == view] or [0.0, 0.0]
    pieces = np.split(np.arange(len(offsets_s)), _dropped_frame_samples(examination, view))
    rows = []
    for number, piece in enumerate(pieces):
        slope = np.polyfit(time_s[piece], offsets_s[piece], 1)[0] if len(piece) > 2 else 0.0
        slope = slope if abs(slope) > 1e-9 else 0.0
        # The view's own timestamps; where frames are missing, that of the next frame.
        since = float(time_s[piece[0]] - offsets_s[piece[0]]) if number else 0.0
        at = float(offsets_s[piece].mean() + slope * (since - (time_s[piece] - offsets_s[piece]).mean()))
        rows.append((since, at, 1e6 * float(slope)))
    start_s, offset_s, drift = zip(*rows, strict=True)
    name = examination.observations.rig.names[view]
    return ViewTiming(name, start_s, offset_s, drift, float(sds[0]), 1e6 * float(sds[1]))


def _dropped_frame_samples(examination: Examination, view: int) -> list[int]:
    """Return the samples from which on a view has dropped more frames."""
    fine = examination.fine
    assert fine is not None
    blocks = fine.final.system.block_index
    steps = {
        int(np.argmax(blocks >= fault.hypothesis.since_block))
        for fault in fine.accepted
        if fault.hypothesis.view == view
        and fault.hypothesis.kind == "dropped"
        and abs(fault.values[-1]) > _MIN_DROPPED_FRAMES * examination.observations.period_s
    }
    return sorted(steps - {0})
