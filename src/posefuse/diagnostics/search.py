"""What is a little wrong with single views: the best explanation first, then what is still wrong with it granted.

A bumped camera also looks like a bad focal length, and makes its neighbours look bad: so nothing is tested by itself.
Of all hypotheses about all views that with the best penalised likelihood is taken, everything accepted is fitted
anew together, and the question is asked again until nothing gains enough.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.diagnostics.clock_model import late_by, likeliest, same_line
from posefuse.diagnostics.hypotheses import (
    CLOCKS,
    Hypothesis,
    Unknown,
    Verdict,
    drift_alone,
    effect_of,
    hypotheses,
    judge,
    offsets_of_all,
    promising,
    solve,
    told,
    usual_effect,
)
from posefuse.diagnostics.linear_system import System, block_of, linearise
from posefuse.diagnostics.observations import Evidence
from posefuse.diagnostics.points import Points, solve_points
from posefuse.diagnostics.state import N_COLUMNS, State, look

THRESHOLD = 10.0
"""Of the penalised gain: what a healthy recording, with some forty numbers that may be wrong, hardly ever reaches."""
_STEPS = 3
_FINAL_STEPS = 8
_STILL = 0.1
_CLOSE = 0.6
_MOST_RIVALS = 4
_LIMITS = np.array([0.2] * 3 + [0.5] * 3 + [0.2, 0.1, 0.3, 0.2])


@dataclass(frozen=True, eq=False)
class Looked:
    """One look at the recording.

    Attributes:
        state: what was believed.
        points: of the samples.
        system: linearised there.
    """

    state: State
    points: Points
    system: System


@dataclass(frozen=True, eq=False)
class Found:
    """Something wrong that was found.

    Attributes:
        verdict: what the data said when it was taken.
        values: shape (unknown,): as fitted with everything else in the end.
        sds: shape (unknown,): of the values.
        rivals: other hypotheses of the same gain, about other views or other things.
    """

    verdict: Verdict
    values: np.ndarray
    sds: np.ndarray
    rivals: tuple[Verdict, ...] = ()

    @property
    def hypothesis(self) -> Hypothesis:
        """What it is."""
        return self.verdict.hypothesis


@dataclass(frozen=True, eq=False)
class Fine:
    """What the fine search ends with.

    Attributes:
        given: the first look.
        last: the last one.
        found: what is wrong, most certain first.
        effect: how many observations count as one, mostly.
    """

    given: Looked
    last: Looked
    found: tuple[Found, ...]
    effect: float


def search(evidence: Evidence, state: State, free: Sequence[str], block_s: float, doubt: float = 1.0) -> Fine:
    """Find what is a little wrong.

    Args:
        evidence: the recording.
        state: what is believed, right but for little; of the samples to look at.
        free: ``pose``, ``lens``, ``late``: what may be wrong.
        block_s: length of the blocks of time that count as independent.
        doubt: how many times the threshold what is no clock has to gain; if more than once, no more such things are
            granted than half as many as there are views.
    """
    runs = evidence.runs[state.frames]
    blocks = block_of(evidence.frame_time_s[state.frames], runs, block_s)
    looker = _Looker(evidence, blocks, doubt=doubt)
    first = now = looker.look(state)
    looker = replace(looker, scale=first.points.scale)
    found: list[Found] = []
    effect = usual_effect(now.system, evidence.n_views)
    verdicts = _judged(now.system, (), free, effect, evidence.n_views)
    if "late" in free:
        found, now = looker.unsynchronised(now, verdicts, effect)
    for _ in range(2 * evidence.n_views):
        if found:
            accepted = tuple(unknown for item in found for unknown in item.hypothesis.unknowns)
            verdicts = _judged(now.system, accepted, free, effect, evidence.n_views)
        if doubt > 1.0 and sum(not _is_clock(item) for item in found) >= evidence.n_views // 2:
            verdicts = [verdict for verdict in verdicts if verdict.hypothesis.kind in CLOCKS]
        chosen = looker.choose(now, found, verdicts)
        if chosen is None:
            break
        found, now = chosen
        effect = min(effect, usual_effect(now.system, evidence.n_views))
    if found:
        found, now = looker.timed(*looker.settle(now, found, _FINAL_STEPS))
        found, now = looker.without_needless(now, found, 0.5 * THRESHOLD)
    return Fine(first, now, tuple(_with_sds(now.system, found)), effect)


def _judged(
    system: System, accepted: tuple[Unknown, ...], free: Sequence[str], effect: float, views: int
) -> list[Verdict]:
    """Verdicts on all hypotheses about views that others check, the best first."""
    told = [v for v in range(views) if system.seen[v] > 0]
    every = (h for v in told for h in promising(system, accepted, hypotheses(system, v, free), effect))
    verdicts = (judge(system, accepted, h, effect) for h in every)
    return sorted((v for v in verdicts if np.isfinite(v.gain)), key=lambda verdict: -verdict.score)


@dataclass(frozen=True, eq=False)
class _Looker:
    evidence: Evidence
    blocks: np.ndarray
    scale: float | None = None
    doubt: float = 1.0

    def look(self, state: State, before: Points | None = None) -> Looked:
        """A look at what is believed, from points that are nearly right if there are any."""
        start = None if before is None else before.points_m
        points = solve_points(self.evidence, state, look(self.evidence, state), self.scale, start)
        system = linearise(self.evidence, state, points, self.blocks)
        return Looked(state, points, system)

    def unsynchronised(self, now: Looked, verdicts: list[Verdict], effect: float) -> tuple[list[Found], Looked]:
        """Where cameras that ran each for itself explain more than any one thing about one view: their offsets.

        Of several offsets each by itself looks much like a pose that is off, and that, once taken, leaves the others
        to be explained by worse.
        """
        offsets = offsets_of_all(now.system, self.evidence.n_views, effect)
        if offsets is None or not verdicts:
            return [], now
        best = max(verdicts, key=lambda verdict: verdict.score)
        # Beyond the best, not beside it: scores of what is very wrong grow slowly, and are all alike.
        more = told(now.system, max(offsets.raw - best.raw, 0.0) / offsets.effect)
        if more < THRESHOLD + offsets.hypothesis.penalty - best.hypothesis.penalty:
            return [], now
        items = []
        for unknown in offsets.hypothesis.unknowns:
            others = tuple(other for other in offsets.hypothesis.unknowns if other is not unknown)
            one = judge(now.system, others, Hypothesis("late", unknown.view, (unknown,)), effect)
            items.append(Found(one, np.zeros(1), one.sds))
        items.sort(key=lambda item: -item.verdict.score)
        found, looked = self.timed(*self.settle(now, items, _STEPS))
        effect = min(effect, usual_effect(looked.system, self.evidence.n_views))
        found = [_scattered(looked.system, item, effect) for item in found]
        return self.without_needless(*self.drifting(looked, found, effect), THRESHOLD)

    def drifting(self, now: Looked, items: list[Found], effect: float) -> tuple[Looked, list[Found]]:
        """The same with what surely drifts: clocks that run each for itself do."""
        views = [v for v in range(self.evidence.n_views) if now.system.seen[v] > 0]
        for _ in views:
            accepted = tuple(unknown for item in items for unknown in item.hypothesis.unknowns)
            steady = [v for v in views if all(i.hypothesis.view != v or i.hypothesis.kind == "late" for i in items)]
            verdicts = [judge(now.system, accepted, drift_alone(now.system, v), effect) for v in steady]
            best = max(verdicts, key=lambda verdict: verdict.score, default=None)
            if best is None or best.score < 0.5 * THRESHOLD:
                break
            view = best.hypothesis.view
            one = Found(best, np.zeros(1), best.sds)
            for own in (item for item in items if item.hypothesis.view == view):
                both = Hypothesis("drift", view, (*own.hypothesis.unknowns, *best.hypothesis.unknowns))
                sds = np.concatenate([own.sds, best.sds])
                one = Found(replace(own.verdict, hypothesis=both), np.append(own.values, 0.0), sds)
            items, now = self.settle(now, [*(i for i in items if i.hypothesis.view != view), one], _STEPS)
        return now, items

    def without_needless(self, now: Looked, items: list[Found], least: float) -> tuple[list[Found], Looked]:
        """The same but for clocks that are right as far as can be told, once all the rest is granted."""
        while True:
            worth = {k: _worth(now.system, items, k) for k in range(len(items)) if _is_clock(items[k])}
            needless = min(worth, key=lambda k: worth[k], default=None)
            if needless is None or worth[needless] >= least:
                return items, now
            gone, items = items[needless], items[:needless] + items[needless + 1 :]
            changes = _changes(now.state, self.blocks, gone.hypothesis.unknowns, -gone.values)
            now = self.look(now.state.corrected(changes), now.points)
            if items:
                items, now = self.settle(now, items, _STEPS)

    def choose(self, now: Looked, found: list[Found], verdicts: list[Verdict]) -> tuple[list[Found], Looked] | None:
        """The best hypothesis fitted with all that was accepted, or None where none gains enough."""
        good = [v for v in verdicts if v.score > THRESHOLD * (1.0 if v.hypothesis.kind in CLOCKS else self.doubt)]
        if not good:
            return None
        best, (accepted, looked) = self.fitting(now, found, _rivals(good))
        close = [v for v in good[1:] if v.score > _CLOSE * best.score and not _same(v, best)]
        accepted[-1] = replace(accepted[-1], rivals=tuple(_one_each(close)))
        return accepted, looked

    def fitting(
        self, now: Looked, found: list[Found], rivals: Sequence[Verdict]
    ) -> tuple[Verdict, tuple[list[Found], Looked]]:
        """Of the best hypothesis and its rivals the one that fits best, and its fit.

        Far from what is believed straight lines mislead: each is fitted. They hold for clocks, and what fits is no
        judge of these: between frames, where points are put on straight lines, errors average out.
        """
        if rivals[0].hypothesis.kind in CLOCKS:
            return rivals[0], self.timed(*self.fit(now, found, rivals[0]))
        tried = [(v, self.fit(now, found, v)) for v in rivals if v.hypothesis.kind not in CLOCKS]
        effect = min(usual_effect(looked.system, self.evidence.n_views) for _, (_, looked) in tried)
        costs = [2.0 * looked.points.cost / effect + v.hypothesis.penalty for v, (_, looked) in tried]
        return tried[int(np.argmin(costs))]

    def fit(self, now: Looked, found: list[Found], verdict: Verdict) -> tuple[list[Found], Looked]:
        """Everything accepted and one thing more, fitted together in a few steps."""
        return self.settle(now, [*found, Found(verdict, np.zeros(len(verdict.values)), verdict.sds)], _STEPS)

    def timed(self, items: list[Found], now: Looked) -> tuple[list[Found], Looked]:
        """The same with every clock wrong in the likeliest way, as the others' corrections leave it."""
        views = [item.hypothesis.view for item in items if item.hypothesis.kind in CLOCKS]
        state, out = now.state, list(items)
        for place, item in enumerate(items):
            view = item.hypothesis.view
            if item.hypothesis.kind not in CLOCKS or views.count(view) > 1:
                continue
            granted = late_by(item.hypothesis, item.values)
            line = likeliest(now.system, view, granted, self.evidence.period_s, item.verdict.effect)
            if line is not None and not same_line(line.hypothesis, item.hypothesis):
                state = state.with_late(view, (line.late_s - granted)[self.blocks])
                verdict = replace(item.verdict, hypothesis=line.hypothesis, values=line.values, sds=line.sds)
                out[place] = replace(item, verdict=verdict, values=line.values, sds=line.sds)
        return (items, now) if state is now.state else self.settle(self.look(state, now.points), out, _STEPS)

    def settle(self, now: Looked, items: list[Found], steps: int) -> tuple[list[Found], Looked]:
        """Everything accepted fitted together, until it stays."""
        sds = np.concatenate([item.sds for item in items])
        for _ in range(steps):
            unknowns = [unknown for item in items for unknown in item.hypothesis.unknowns]
            values = _within(unknowns, solve(now.system, unknowns)[0])
            now = self.look(now.state.corrected(_changes(now.state, self.blocks, unknowns, values)), now.points)
            parts = np.split(values, np.cumsum([len(item.values) for item in items])[:-1])
            items = [replace(item, values=item.values + part) for item, part in zip(items, parts, strict=True)]
            if (np.abs(values) < _STILL * sds).all():
                break
        return items, now


def _within(unknowns: Sequence[Unknown], values: np.ndarray) -> np.ndarray:
    """Steps no longer than straight lines hold."""
    most = _scale_of(unknowns)
    return values * min(1.0, 1.0 / max(float(np.abs(values / most).max()), 1e-9))


def _scale_of(unknowns: Sequence[Unknown]) -> np.ndarray:
    reach = np.array([np.abs(unknown.profile).max() for unknown in unknowns])
    return _LIMITS[[unknown.column for unknown in unknowns]] / np.maximum(reach, 1e-9)


def _changes(state: State, blocks: np.ndarray, unknowns: Sequence[Unknown], values: np.ndarray) -> np.ndarray:
    changes = np.zeros((*state.late_s.shape, N_COLUMNS))
    for unknown, value in zip(unknowns, values, strict=True):
        changes[:, unknown.view, unknown.column] += value * unknown.profile[blocks]
    return changes


def _scattered(system: System, item: Found, usual: float) -> Found:
    """The same with its scatter as it is once the others are granted: what they got wrong made it larger."""
    values = solve(system, item.hypothesis.unknowns)[0]
    effect = effect_of(system, item.hypothesis, values, usual)
    return replace(item, verdict=replace(item.verdict, effect=effect))


def _is_clock(item: Found) -> bool:
    return item.hypothesis.kind in CLOCKS


def _worth(system: System, items: Sequence[Found], place: int) -> float:
    """By how much more than its penalty the fit would be worse without one of the things found (Wald's test)."""
    unknowns = [unknown for item in items for unknown in item.hypothesis.unknowns]
    start = sum(len(item.values) for item in items[:place])
    own, item = slice(start, start + len(items[place].values)), items[place]
    loss = float(item.values @ np.linalg.solve(solve(system, unknowns)[1][own, own], item.values))
    return told(system, loss / item.verdict.effect) - item.hypothesis.penalty


def _same(a: Verdict, b: Verdict) -> bool:
    return a.hypothesis.view == b.hypothesis.view and a.hypothesis.kind == b.hypothesis.kind


def _one_each(verdicts: Sequence[Verdict]) -> list[Verdict]:
    """The best of each view and kind."""
    seen: dict[tuple[int, str], Verdict] = {}
    for verdict in verdicts:
        seen.setdefault((verdict.hypothesis.view, verdict.hypothesis.kind), verdict)
    return list(seen.values())


def _rivals(good: Sequence[Verdict]) -> list[Verdict]:
    """The best few of different views and kinds that come near the best of all."""
    near = [verdict for verdict in _one_each(good) if verdict.score > _CLOSE * good[0].score]
    return near[:_MOST_RIVALS]


def _with_sds(system: System, found: list[Found]) -> list[Found]:
    if not found:
        return []
    unknowns = [unknown for item in found for unknown in item.hypothesis.unknowns]
    variances = np.maximum(np.diag(solve(system, unknowns)[1]), 0.0)
    parts = np.split(variances, np.cumsum([len(item.values) for item in found])[:-1])
    return [replace(item, sds=np.sqrt(part * item.verdict.effect)) for item, part in zip(found, parts, strict=True)]
