"""Estimate time offsets of independently started cameras from the lags at which pairs of views agree best."""

from itertools import combinations

import numpy as np

from posefuse.diagnostics.epipolar import disagreement, posed_view, posed_views
from posefuse.diagnostics.normalized_views import normalize_views
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_model import RecordingModel

_ROUNDS = 2


def estimate_start_offsets(
    observations: TrackedObservations, model: RecordingModel, scale: float, step_s: float, reach: int
) -> np.ndarray:
    """Estimate the time offset of every view, shape (view,), in seconds; the medoid view has offset 0.

    Pairs are joined into a spanning tree in order of agreement, so that a view that agrees with no other cannot shift
    the rest. Each view is then refined to agree best with all others.

    Args:
        observations: of the recording.
        model: current recording model.
        scale: noise as a multiple of the expected noise.
        step_s: step between the lags to test.
        reach: number of lags to test on either side.
    """
    lags = step_s * np.arange(-reach, reach + 1)
    unshifted = posed_views(observations, model, normalize_views(observations, model), scale)
    costs = np.full((len(unshifted), len(unshifted), len(lags)), np.inf)
    for b in range(1, len(unshifted)):
        shifted = [posed_view(observations, model.with_offset(b, lag), b, scale) for lag in lags]
        for a in range(b):
            costs[a, b] = [nan_to_inf(disagreement(unshifted[a], one)) for one in shifted]
    offset_s = offsets_from_pairs(costs, lags)
    for _ in range(_ROUNDS):
        for v in range(len(unshifted)):
            offset_s[v] += _refinement_s(observations, model, offset_s, v, scale, step_s)
    return offset_s


def offsets_from_pairs(costs: np.ndarray, lags_s: np.ndarray) -> np.ndarray:
    """Combine pairwise lags into time offsets, shape (view,); the medoid of each connected group has offset 0.

    Args:
        costs: shape (view, view, lag): disagreement of views a < b if b is later than a by the lag; not finite where
            they share nothing.
        lags_s: shape (lag,).
    """
    views = len(costs)
    offset_s, group = np.zeros(views), np.arange(views)
    best = [(costs[a, b].min(), a, b) for a, b in combinations(range(views), 2) if np.isfinite(costs[a, b]).any()]
    for _, a, b in sorted(best):
        if group[a] != group[b]:
            moved = group == group[b]
            offset_s[moved] += offset_s[a] + lags_s[np.argmin(costs[a, b])] - offset_s[b]
            group[moved] = group[a]
    for label in np.unique(group):
        offset_s[group == label] -= medoid(offset_s[group == label])
    return offset_s


def medoid(values: np.ndarray) -> float:
    """Return the value with the smallest total distance to all others: where most agree, theirs."""
    return float(values[medoid_index(values)])


def medoid_index(values: np.ndarray) -> int:
    """Return the index of the medoid."""
    return int(np.argmin(np.abs(values - values[:, None]).sum(axis=1)))


def _refinement_s(
    observations: TrackedObservations,
    model: RecordingModel,
    offset_s: np.ndarray,
    view: int,
    scale: float,
    step_s: float,
) -> float:
    """Return the fraction of a step by which a view must shift to agree best with all others."""
    for v, view_offset_s in enumerate(offset_s):
        model = model.with_offset(v, view_offset_s)
    others = posed_views(observations, model, normalize_views(observations, model), scale)
    shifts_s = step_s * np.array([0.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75])
    costs = []
    for lag in shifts_s:
        mine = posed_view(observations, model.with_offset(view, lag), view, scale)
        row = np.array([disagreement(mine, other) for u, other in enumerate(others) if u != view])
        row = row[np.isfinite(row)]
        costs.append(np.median(row) if len(row) else np.inf)
    return float(shifts_s[int(np.argmin(costs))])


def nan_to_inf(value: float) -> float:
    """Return the value, or infinity if it is NaN."""
    return value if np.isfinite(value) else np.inf
