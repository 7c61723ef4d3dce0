"""When cameras were started that nobody started together: from how well pairs of them agree at one lag or another."""

from itertools import combinations

import numpy as np

from posefuse.diagnostics.epipolar import disagreement, look_of, looks
from posefuse.diagnostics.observations import Evidence
from posefuse.diagnostics.state import State, look

_ROUNDS = 2


def offsets_of_pairs(evidence: Evidence, state: State, scale: float, step_s: float, reach: int) -> np.ndarray:
    """Shape (view,): how late views are, s, the one amid them 0; each agrees best with those it agrees with at all.

    Pairs are joined to a tree, those that agree best first, as no pair is needed twice and a view that agrees with
    nobody must not draw the others along. Then each view is put where it agrees best with all of them.

    Args:
        evidence: the recording.
        state: what is believed so far.
        scale: of the noise, as a multiple of the usual.
        step_s: between the lags that are tried.
        reach: so many to either side.
    """
    lags = step_s * np.arange(-reach, reach + 1)
    still = looks(evidence, state, look(evidence, state), scale)
    costs = np.full((len(still), len(still), len(lags)), np.inf)
    for b in range(1, len(still)):
        moved = [look_of(evidence, state.with_late(b, lag), b, scale) for lag in lags]
        for a in range(b):
            costs[a, b] = [or_inf(disagreement(still[a], one)) for one in moved]
    late_s = joined(costs, lags)
    for _ in range(_ROUNDS):
        for v in range(len(still)):
            late_s[v] += _nudge(evidence, state, late_s, v, scale, step_s)
    return late_s


def joined(costs: np.ndarray, lags_s: np.ndarray) -> np.ndarray:
    """Shape (view,): how late views are by the pairs that agree best, the one amid those that are joined 0.

    Args:
        costs: shape (view, view, lag): how much views a < b disagree where b is so much later than a; not finite where
            they have nothing in common.
        lags_s: shape (lag,).
    """
    views = len(costs)
    late_s, group = np.zeros(views), np.arange(views)
    best = [(costs[a, b].min(), a, b) for a, b in combinations(range(views), 2) if np.isfinite(costs[a, b]).any()]
    for _, a, b in sorted(best):
        if group[a] != group[b]:
            moved = group == group[b]
            late_s[moved] += late_s[a] + lags_s[np.argmin(costs[a, b])] - late_s[b]
            group[moved] = group[a]
    for one in np.unique(group):
        late_s[group == one] -= amid(late_s[group == one])
    return late_s


def amid(values: np.ndarray) -> float:
    """The value that all are nearest to: where most agree, theirs."""
    return float(values[place_amid(values)])


def place_amid(values: np.ndarray) -> int:
    """Where that value stands."""
    return int(np.argmin(np.abs(values - values[:, None]).sum(axis=1)))


def _nudge(evidence: Evidence, state: State, late_s: np.ndarray, view: int, scale: float, step_s: float) -> float:
    """By how much less than a step a view agrees better with all the others."""
    for v, late in enumerate(late_s):
        state = state.with_late(v, late)
    others = looks(evidence, state, look(evidence, state), scale)
    tried = step_s * np.array([0.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75])
    costs = []
    for lag in tried:
        mine = look_of(evidence, state.with_late(view, lag), view, scale)
        row = np.array([disagreement(mine, other) for u, other in enumerate(others) if u != view])
        row = row[np.isfinite(row)]
        costs.append(np.median(row) if len(row) else np.inf)
    return float(tried[int(np.argmin(costs))])


def or_inf(value: float) -> float:
    """A cost that is not known, as the largest."""
    return value if np.isfinite(value) else np.inf
