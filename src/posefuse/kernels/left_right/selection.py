"""Selection of the best candidate per lane, and detection of rivals that explain the views almost as well."""

import math

from posefuse.kernels import status_codes
from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.cameras.points import INFORMATION
from posefuse.kernels.jit import inline, subroutine
from posefuse.kernels.left_right.refine import CANDIDATE_COST, CANDIDATE_ROWS

# A point is ambiguous if a rival costs less than this fraction of an unexplained observation more.
_CLEAR_LEAD = 0.5
# A point is undecided if the costs differ by less than this fraction and the points by more than this distance.
_TIE = 0.075
_MIN_DISTANCE_SQUARED = 36.0


@inline
def _motion_cost(candidate, side, j, last, other, sigma, bound):
    """Return the bounded cost of the motion of one point since the previous frame; 0 if it was missing there."""
    squared = 0.0
    for axis in range(3):
        offset = (candidate[3 * side + axis, j] - last[3 * other + axis]) / sigma
        squared += offset * offset
    absent = last[3 * other] != last[3 * other]
    return 0.0 if absent else (squared if squared < bound else bound)


@inline
def _continuity_cost(candidate, j, last, sigma, bound):
    """Return the cost of the motion of a candidate since the previous frame, in the cheaper of both orders."""
    kept_order = _motion_cost(candidate, 0, j, last, 0, sigma, bound)
    kept_order += _motion_cost(candidate, 1, j, last, 1, sigma, bound)
    swapped_order = _motion_cost(candidate, 0, j, last, 1, sigma, bound)
    swapped_order += _motion_cost(candidate, 1, j, last, 0, sigma, bound)
    return min(kept_order, swapped_order)


@subroutine
def choose_candidate(candidates, lane_indices, sigma, bound, previous, totals, best, candidate):
    """Choose the cheapest refined candidate of every lane, lanes in the order of frames.

    Args:
        candidates: shape (candidate, CANDIDATE_ROWS, BLOCK).
        lane_indices: shape (2, BLOCK): person-frame (-1: none) and pair.
        sigma: standard deviation of the motion between frames; inf disables the motion cost.
        bound: maximum cost of the motion of one point.
        previous: shape (person, pair, 6), in and out: the points of the previous frame.
        totals: shape (candidate, BLOCK), written: costs including those of the motion.
        best: shape (BLOCK,), int64, written: the chosen one.
        candidate: shape (CANDIDATE_ROWS, BLOCK), written: its values.
    """
    for j in range(BLOCK):
        n = lane_indices[0, j]
        k = lane_indices[1, j]
        person = n % previous.shape[0]
        cheapest = 0
        for i in range(candidates.shape[0]):
            totals[i, j] = candidates[i, CANDIDATE_COST, j]
            if n >= 0 and sigma < math.inf:
                totals[i, j] += _continuity_cost(candidates[i], j, previous[person, k], sigma, bound)
            cheapest = i if totals[i, j] < totals[cheapest, j] else cheapest
        best[j] = cheapest
        for i in range(CANDIDATE_ROWS):
            candidate[i, j] = candidates[cheapest, i, j]
        if n >= 0:
            for i in range(6):
                previous[person, k, i] = candidate[i, j]


@inline
def _distance_squared(candidate, rival, side, other, j, state):
    """Return the squared distance of a rival's point in standard errors; inf where the rival has none."""
    x = rival[3 * other, j] - candidate[3 * side, j]
    y = rival[3 * other + 1, j] - candidate[3 * side + 1, j]
    z = rival[3 * other + 2, j] - candidate[3 * side + 2, j]
    i = INFORMATION
    squared = x * (state[i, j] * x + 2.0 * (state[i + 1, j] * y + state[i + 2, j] * z))
    squared += y * (state[i + 3, j] * y + 2.0 * state[i + 4, j] * z) + z * z * state[i + 5, j]
    return squared if squared == squared else math.inf


@subroutine
def flag_rivals(candidates, totals, best, candidate, side, state, bound, status):
    """Flag points that a rival candidate of about the same cost does not contain.

    Args:
        candidates: shape (candidate, CANDIDATE_ROWS, BLOCK).
        totals: shape (candidate, BLOCK).
        best: shape (BLOCK,), the chosen candidate.
        candidate: shape (CANDIDATE_ROWS, BLOCK), the chosen one, refined and in order.
        side: 0 or 1: which of its points.
        state: shape (STATE_ROWS, BLOCK), of that point.
        bound: cost of an unexplained observation.
        status: shape (BLOCK,), in and out: point codes.
    """
    for j in range(BLOCK):
        if status[j] >= status_codes.POINT_MISSING:
            continue
        for i in range(candidates.shape[0]):
            lead = totals[i, j] - totals[best[j], j]
            exists = candidates[i, 0, j] == candidates[i, 0, j] or candidates[i, 3, j] == candidates[i, 3, j]
            if i == best[j] or not exists or lead >= _CLEAR_LEAD * bound:
                continue
            rival = candidates[i]
            distance_squared = min(
                _distance_squared(candidate, rival, side, 0, j, state),
                _distance_squared(candidate, rival, side, 1, j, state),
            )
            if distance_squared > _MIN_DISTANCE_SQUARED:
                code = status_codes.POINT_UNDECIDED if lead < _TIE * bound else status_codes.POINT_AMBIGUOUS
                status[j] = max(status[j], code)
