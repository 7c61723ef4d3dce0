"""Which couple of points explains the views best, and whether another does about as well."""

import math

from posefuse.kernels import status_codes
from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.cameras.points import INFORMATION
from posefuse.kernels.jit import inline, step
from posefuse.kernels.left_right.refine import COUPLE_COST, COUPLE_ROWS

# A rival explanation must cost more than the best by this share of what an unexplained observation costs.
_CLEAR_LEAD = 0.5
# So near there is no telling which of the two is right; they are two if they lie so many standard errors apart.
_TIE = 0.075
_APART_SQUARED = 36.0


@inline
def _moved(couple, side, j, previous, person, k, other, sigma, bound):
    """The bounded cost of one point having been where one of the frame before was; 0 if that was nowhere."""
    squared = 0.0
    for axis in range(3):
        offset = (couple[3 * side + axis, j] - previous[person, k, 3 * other + axis]) / sigma
        squared += offset * offset
    nowhere = previous[person, k, 3 * other] != previous[person, k, 3 * other]
    return 0.0 if nowhere else (squared if squared < bound else bound)


@inline
def _prior_cost(couple, j, previous, person, k, sigma, bound):
    """What a couple costs, given the points of the frame before, in the better of the two orders."""
    straight = _moved(couple, 0, j, previous, person, k, 0, sigma, bound)
    straight += _moved(couple, 1, j, previous, person, k, 1, sigma, bound)
    crossed = _moved(couple, 0, j, previous, person, k, 1, sigma, bound)
    crossed += _moved(couple, 1, j, previous, person, k, 0, sigma, bound)
    return min(straight, crossed)


@step
def choose(couples, places, sigma, bound, previous, totals, best, couple):
    """The cheapest of the refined couples of every lane, lanes in the order of frames.

    Args:
        couples: shape (couple, COUPLE_ROWS, BLOCK).
        places: shape (2, BLOCK): person-frame (-1: none) and pair.
        sigma: how far points move between frames, inf: do not ask.
        bound: the most that one point's having moved costs.
        previous: shape (person, pair, 6), in and out: the points of the frame before.
        totals: shape (couple, BLOCK), written: costs, with those of having moved.
        best: shape (BLOCK,), int64, written: the chosen one.
        couple: shape (COUPLE_ROWS, BLOCK), written: it.
    """
    for j in range(BLOCK):
        n = places[0, j]
        k = places[1, j]
        person = n % previous.shape[0]
        chosen = 0
        for i in range(couples.shape[0]):
            totals[i, j] = couples[i, COUPLE_COST, j]
            if n >= 0 and sigma < math.inf:
                totals[i, j] += _prior_cost(couples[i], j, previous, person, k, sigma, bound)
            chosen = i if totals[i, j] < totals[chosen, j] else chosen
        best[j] = chosen
        for i in range(COUPLE_ROWS):
            couple[i, j] = couples[chosen, i, j]
        if n >= 0:
            for i in range(6):
                previous[person, k, i] = couple[i, j]


@inline
def _apart_squared(couple, rival, side, other, j, state):
    """How far a rival's point is from ours, in squared standard errors; infinitely where it has none."""
    x = rival[3 * other, j] - couple[3 * side, j]
    y = rival[3 * other + 1, j] - couple[3 * side + 1, j]
    z = rival[3 * other + 2, j] - couple[3 * side + 2, j]
    i = INFORMATION
    squared = x * (state[i, j] * x + 2.0 * (state[i + 1, j] * y + state[i + 2, j] * z))
    squared += y * (state[i + 3, j] * y + 2.0 * state[i + 4, j] * z) + z * z * state[i + 5, j]
    return squared if squared == squared else math.inf


@step
def doubt(couples, totals, best, couple, side, state, bound, status):
    """Say of points that another couple, which costs about as much, does without them.

    Args:
        couples: shape (couple, COUPLE_ROWS, BLOCK).
        totals: shape (couple, BLOCK).
        best: shape (BLOCK,), the chosen one.
        couple: shape (COUPLE_ROWS, BLOCK), it, settled and in order.
        side: 0 or 1, which of its points.
        state: shape (STATE_ROWS, BLOCK), of that point.
        bound: what an unexplained observation costs.
        status: shape (BLOCK,), in and out: point codes.
    """
    for j in range(BLOCK):
        if status[j] >= status_codes.POINT_MISSING:
            continue
        for i in range(couples.shape[0]):
            lead = totals[i, j] - totals[best[j], j]
            there = couples[i, 0, j] == couples[i, 0, j] or couples[i, 3, j] == couples[i, 3, j]
            if i == best[j] or not there or lead >= _CLEAR_LEAD * bound:
                continue
            rival = couples[i]
            apart = min(
                _apart_squared(couple, rival, side, 0, j, state), _apart_squared(couple, rival, side, 1, j, state)
            )
            if apart > _APART_SQUARED:
                code = status_codes.POINT_UNDECIDED if lead < _TIE * bound else status_codes.POINT_AMBIGUOUS
                status[j] = max(status[j], code)
