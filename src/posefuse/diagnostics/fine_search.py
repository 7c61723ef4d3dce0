"""Find small faults of single views by stepwise model selection.

A bumped camera also looks like a wrong focal length, and makes its neighbors look wrong, so no hypothesis is tested
alone. In each step, the hypothesis with the best penalized likelihood over all views is accepted, all accepted
hypotheses are refitted together, and the search repeats until no hypothesis gains enough.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.diagnostics.clock_model import clock_offset_s, fit_clock, same_clock_model
from posefuse.diagnostics.fine_result import AcceptedFault, FineResult, Linearization
from posefuse.diagnostics.hypotheses import (
    CLOCK_KINDS,
    Evaluation,
    Hypothesis,
    Unknown,
    best_of_each,
    centered_drift,
    design_effect_of,
    effective_gain,
    enumerate_hypotheses,
    evaluate,
    evaluate_all_offsets,
    promising_hypotheses,
    solve_unknowns,
    typical_design_effect,
)
from posefuse.diagnostics.linear_system import LinearSystem, linearize, time_blocks
from posefuse.diagnostics.normalized_views import normalize_views
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_model import N_PARAMETERS, RecordingModel
from posefuse.diagnostics.sample_points import SamplePoints, triangulate_samples

THRESHOLD = 10.0
"""Penalized gain required to accept a hypothesis; a fault-free recording, with some forty hypotheses, hardly ever
reaches it.
"""
_STEPS = 3
_FINAL_STEPS = 8
_CONVERGED = 0.1
_COMPETITOR_SHARE = 0.6
_MAX_COMPETITORS = 4
_MAX_STEPS = np.array([0.2] * 3 + [0.5] * 3 + [0.2, 0.1, 0.3, 0.2])


def search(
    observations: TrackedObservations,
    model: RecordingModel,
    groups: Sequence[str],
    block_s: float,
    max_faults: int | None = None,
) -> FineResult:
    """Find small faults of single views.

    Args:
        observations: of the recording.
        model: hypothesis to start from, correct except for small faults; sets the sampled frames.
        groups: which faults to consider: ``pose``, ``lens``, ``clock``.
        block_s: length of the blocks of time that count as independent, in seconds.
        max_faults: largest number of faults to find; by default twice the number of views.
    """
    runs = observations.runs[model.frames]
    blocks = time_blocks(observations.frame_time_s[model.frames], runs, block_s)
    searcher = _Search(observations, blocks)
    initial = current = searcher.linearize_at(model)
    searcher = replace(searcher, scale=initial.points.noise_scale)
    faults: list[AcceptedFault] = []
    effect = typical_design_effect(current.system, observations.n_views)
    evaluations = _evaluate_all(current.system, (), groups, effect, observations.n_views)
    if "clock" in groups:
        faults, current = searcher.unsynchronized(current, evaluations, effect)
    most = 2 * observations.n_views if max_faults is None else max_faults
    complete = False
    for _ in range(most):
        if faults:
            accepted = tuple(unknown for item in faults for unknown in item.hypothesis.unknowns)
            evaluations = _evaluate_all(current.system, accepted, groups, effect, observations.n_views)
        chosen = searcher.accept_best(current, faults, evaluations)
        if chosen is None:
            complete = True
            break
        faults, current = chosen
        effect = min(effect, typical_design_effect(current.system, observations.n_views))
    if faults:
        faults, current = searcher.refit_clocks(*searcher.settle(current, faults, _FINAL_STEPS))
        faults, current = searcher.without_insignificant(current, faults, 0.5 * THRESHOLD)
    return FineResult(initial, current, tuple(_with_sds(current.system, faults)), effect, complete)


def _evaluate_all(
    system: LinearSystem, accepted: tuple[Unknown, ...], groups: Sequence[str], effect: float, views: int
) -> list[Evaluation]:
    """Return evaluations of all promising hypotheses about views that others check, the best first."""
    checked = [v for v in range(views) if system.n_checked[v] > 0]
    every = (
        h
        for v in checked
        for h in promising_hypotheses(system, accepted, enumerate_hypotheses(system, v, groups), effect)
    )
    evaluations = (evaluate(system, accepted, h, effect) for h in every)
    return sorted((v for v in evaluations if np.isfinite(v.gain)), key=lambda evaluation: -evaluation.score)


@dataclass(frozen=True, eq=False)
class _Search:
    """Hold the constants of one search and fit accepted hypotheses."""

    observations: TrackedObservations
    blocks: np.ndarray
    scale: float | None = None

    def linearize_at(self, model: RecordingModel, before: SamplePoints | None = None) -> Linearization:
        """Return the linearization at a model, starting from the points of a similar model if given."""
        start = None if before is None else before.points_m
        points = triangulate_samples(
            self.observations, model, normalize_views(self.observations, model), self.scale, start
        )
        system = linearize(self.observations, model, points, self.blocks)
        return Linearization(model, points, system)

    def unsynchronized(
        self, current: Linearization, evaluations: list[Evaluation], effect: float
    ) -> tuple[list[AcceptedFault], Linearization]:
        """Accept an offset of every clock if that explains more than any single hypothesis.

        Each of several offsets alone resembles a wrong camera pose, and once that is accepted, worse explanations
        follow.
        """
        offsets = evaluate_all_offsets(current.system, self.observations.n_views, effect)
        if offsets is None or not evaluations:
            return [], current
        best = max(evaluations, key=lambda evaluation: evaluation.score)
        # Compare raw gains: effective gains of large faults grow slowly and hardly differ.
        more = effective_gain(current.system, max(offsets.raw_gain - best.raw_gain, 0.0) / offsets.design_effect)
        if more < THRESHOLD + offsets.hypothesis.penalty - best.hypothesis.penalty:
            return [], current
        items = []
        for unknown in offsets.hypothesis.unknowns:
            others = tuple(other for other in offsets.hypothesis.unknowns if other is not unknown)
            one = evaluate(current.system, others, Hypothesis("offset", unknown.view, (unknown,)), effect)
            items.append(AcceptedFault(one, np.zeros(1), one.sds))
        items.sort(key=lambda item: -item.evaluation.score)
        faults, linearization = self.refit_clocks(*self.settle(current, items, _STEPS))
        effect = min(effect, typical_design_effect(linearization.system, self.observations.n_views))
        faults = [_with_design_effect(linearization.system, item, effect) for item in faults]
        return self.without_insignificant(*self.add_drifts(linearization, faults, effect), THRESHOLD)

    def add_drifts(
        self, current: Linearization, items: list[AcceptedFault], effect: float
    ) -> tuple[Linearization, list[AcceptedFault]]:
        """Add drifts to clocks that significantly drift, as independently running clocks do."""
        views = [v for v in range(self.observations.n_views) if current.system.n_checked[v] > 0]
        for _ in views:
            accepted = tuple(unknown for item in items for unknown in item.hypothesis.unknowns)
            without_drift = [
                v for v in views if all(i.hypothesis.view != v or i.hypothesis.kind == "offset" for i in items)
            ]
            evaluations = [
                evaluate(current.system, accepted, centered_drift(current.system, v), effect) for v in without_drift
            ]
            best = max(evaluations, key=lambda evaluation: evaluation.score, default=None)
            if best is None or best.score < 0.5 * THRESHOLD:
                break
            view = best.hypothesis.view
            one = AcceptedFault(best, np.zeros(1), best.sds)
            for own in (item for item in items if item.hypothesis.view == view):
                both = Hypothesis("drift", view, (*own.hypothesis.unknowns, *best.hypothesis.unknowns))
                sds = np.concatenate([own.sds, best.sds])
                one = AcceptedFault(replace(own.evaluation, hypothesis=both), np.append(own.values, 0.0), sds)
            items, current = self.settle(current, [*(i for i in items if i.hypothesis.view != view), one], _STEPS)
        return current, items

    def without_insignificant(
        self, current: Linearization, items: list[AcceptedFault], min_score: float
    ) -> tuple[list[AcceptedFault], Linearization]:
        """Remove clock hypotheses that are no longer significant once all others are accepted."""
        while True:
            scores = {k: _wald_score(current.system, items, k) for k in range(len(items)) if _is_clock(items[k])}
            weakest = min(scores, key=lambda k: scores[k], default=None)
            if weakest is None or scores[weakest] >= min_score:
                return items, current
            removed, items = items[weakest], items[:weakest] + items[weakest + 1 :]
            changes = _parameter_changes(current.model, self.blocks, removed.hypothesis.unknowns, -removed.values)
            current = self.linearize_at(current.model.corrected(changes), current.points)
            if items:
                items, current = self.settle(current, items, _STEPS)

    def accept_best(
        self, current: Linearization, faults: list[AcceptedFault], evaluations: list[Evaluation]
    ) -> tuple[list[AcceptedFault], Linearization] | None:
        """Accept the best hypothesis and refit all; return None if no hypothesis gains enough."""
        significant = [evaluation for evaluation in evaluations if evaluation.score > THRESHOLD]
        if not significant:
            return None
        best, (accepted, linearization) = self.best_fit(current, faults, _candidates(significant))
        similar = [v for v in significant[1:] if v.score > _COMPETITOR_SHARE * best.score and not _same_fault(v, best)]
        accepted[-1] = replace(accepted[-1], competitors=tuple(best_of_each(similar)))
        return accepted, linearization

    def best_fit(
        self, current: Linearization, faults: list[AcceptedFault], competitors: Sequence[Evaluation]
    ) -> tuple[Evaluation, tuple[list[AcceptedFault], Linearization]]:
        """Return the best fitting hypothesis among the best and its competitors, and its fit.

        Linearization misleads far from the model, so each candidate is fitted. Clock hypotheses are nearly linear, and
        their fit is no criterion: between frames, where observations are interpolated, errors average out.
        """
        if competitors[0].hypothesis.kind in CLOCK_KINDS:
            return competitors[0], self.refit_clocks(*self.fit(current, faults, competitors[0]))
        fits = [(v, self.fit(current, faults, v)) for v in competitors if v.hypothesis.kind not in CLOCK_KINDS]
        effect = min(
            typical_design_effect(linearization.system, self.observations.n_views) for _, (_, linearization) in fits
        )
        costs = [2.0 * linearization.points.cost / effect + v.hypothesis.penalty for v, (_, linearization) in fits]
        return fits[int(np.argmin(costs))]

    def fit(
        self, current: Linearization, faults: list[AcceptedFault], evaluation: Evaluation
    ) -> tuple[list[AcceptedFault], Linearization]:
        """Fit all accepted hypotheses and one more in a few steps."""
        return self.settle(
            current, [*faults, AcceptedFault(evaluation, np.zeros(len(evaluation.values)), evaluation.sds)], _STEPS
        )

    def refit_clocks(
        self, items: list[AcceptedFault], current: Linearization
    ) -> tuple[list[AcceptedFault], Linearization]:
        """Replace every clock hypothesis by the best clock model, given the corrections of the others."""
        views = [item.hypothesis.view for item in items if item.hypothesis.kind in CLOCK_KINDS]
        model, out = current.model, list(items)
        for place, item in enumerate(items):
            view = item.hypothesis.view
            if item.hypothesis.kind not in CLOCK_KINDS or views.count(view) > 1:
                continue
            current_offset_s = clock_offset_s(item.hypothesis, item.values)
            clock_fit = fit_clock(
                current.system, view, current_offset_s, self.observations.period_s, item.evaluation.design_effect
            )
            if clock_fit is not None and not same_clock_model(clock_fit.hypothesis, item.hypothesis):
                model = model.with_offset(view, (clock_fit.offset_s - current_offset_s)[self.blocks])
                evaluation = replace(
                    item.evaluation, hypothesis=clock_fit.hypothesis, values=clock_fit.values, sds=clock_fit.sds
                )
                out[place] = replace(item, evaluation=evaluation, values=clock_fit.values, sds=clock_fit.sds)
        return (
            (items, current)
            if model is current.model
            else self.settle(self.linearize_at(model, current.points), out, _STEPS)
        )

    def settle(
        self, current: Linearization, items: list[AcceptedFault], steps: int
    ) -> tuple[list[AcceptedFault], Linearization]:
        """Fit all accepted hypotheses together until the values converge."""
        sds = np.concatenate([item.sds for item in items])
        for _ in range(steps):
            unknowns = [unknown for item in items for unknown in item.hypothesis.unknowns]
            values = _limit_step(unknowns, solve_unknowns(current.system, unknowns)[0])
            current = self.linearize_at(
                current.model.corrected(_parameter_changes(current.model, self.blocks, unknowns, values)),
                current.points,
            )
            parts = np.split(values, np.cumsum([len(item.values) for item in items])[:-1])
            items = [replace(item, values=item.values + part) for item, part in zip(items, parts, strict=True)]
            if (np.abs(values) < _CONVERGED * sds).all():
                break
        return items, current


def _limit_step(unknowns: Sequence[Unknown], values: np.ndarray) -> np.ndarray:
    """Shorten a step to the range in which the linearization holds."""
    limits = _step_limits(unknowns)
    return values * min(1.0, 1.0 / max(float(np.abs(values / limits).max()), 1e-9))


def _step_limits(unknowns: Sequence[Unknown]) -> np.ndarray:
    """Return the largest step of each unknown."""
    largest = np.array([np.abs(unknown.profile).max() for unknown in unknowns])
    return _MAX_STEPS[[unknown.parameter for unknown in unknowns]] / np.maximum(largest, 1e-9)


def _parameter_changes(
    model: RecordingModel, blocks: np.ndarray, unknowns: Sequence[Unknown], values: np.ndarray
) -> np.ndarray:
    """Return the parameter changes of some unknowns, shape (sample, view, parameter)."""
    changes = np.zeros((*model.offset_s.shape, N_PARAMETERS))
    for unknown, value in zip(unknowns, values, strict=True):
        changes[:, unknown.view, unknown.parameter] += value * unknown.profile[blocks]
    return changes


def _with_design_effect(system: LinearSystem, item: AcceptedFault, typical: float) -> AcceptedFault:
    """Recompute a fault's design effect once the others are accepted, since their errors inflated it."""
    values = solve_unknowns(system, item.hypothesis.unknowns)[0]
    effect = design_effect_of(system, item.hypothesis, values, typical)
    return replace(item, evaluation=replace(item.evaluation, design_effect=effect))


def _is_clock(item: AcceptedFault) -> bool:
    """Return whether an accepted fault concerns a clock."""
    return item.hypothesis.kind in CLOCK_KINDS


def _wald_score(system: LinearSystem, items: Sequence[AcceptedFault], place: int) -> float:
    """Return the effective gain of one accepted fault in the joint fit minus its penalty (Wald test)."""
    unknowns = [unknown for item in items for unknown in item.hypothesis.unknowns]
    start = sum(len(item.values) for item in items[:place])
    own, item = slice(start, start + len(items[place].values)), items[place]
    loss = float(item.values @ np.linalg.solve(solve_unknowns(system, unknowns)[1][own, own], item.values))
    return effective_gain(system, loss / item.evaluation.design_effect) - item.hypothesis.penalty


def _same_fault(a: Evaluation, b: Evaluation) -> bool:
    """Return whether two hypotheses concern the same view and kind."""
    return a.hypothesis.view == b.hypothesis.view and a.hypothesis.kind == b.hypothesis.kind


def _candidates(significant: Sequence[Evaluation]) -> list[Evaluation]:
    """Return the best few evaluations of different views and kinds whose scores come close to the best."""
    similar = [
        evaluation
        for evaluation in best_of_each(significant)
        if evaluation.score > _COMPETITOR_SHARE * significant[0].score
    ]
    return similar[:_MAX_COMPETITORS]


def _with_sds(system: LinearSystem, faults: list[AcceptedFault]) -> list[AcceptedFault]:
    """Set the standard deviations from the joint fit."""
    if not faults:
        return []
    unknowns = [unknown for item in faults for unknown in item.hypothesis.unknowns]
    variances = np.maximum(np.diag(solve_unknowns(system, unknowns)[1]), 0.0)
    parts = np.split(variances, np.cumsum([len(item.values) for item in faults])[:-1])
    return [
        replace(item, sds=np.sqrt(part * item.evaluation.design_effect))
        for item, part in zip(faults, parts, strict=True)
    ]
