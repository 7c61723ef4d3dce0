"""How people hold themselves: how upright they are, how far all leans from the trunk, and on what height they stand."""

import math

import numpy as np

from posefuse.kernels.jit import kernel
from posefuse.kernels.tracking.bodies import differentiate, locate


@kernel
def note_leans(turns, bones, firm, dt_s, memory_s, looked_s, leans, variance, upright):
    """Means over the last ``memory_s`` of how people lean who are well seen; of all there was at first.

    Args:
        turns: shape (person, segment, 3, 3); the first segment is the trunk, its third axis is up.
        bones: shape (person, bone, 3, 3).
        firm: shape (person,), bool: who is well seen.
        dt_s: since the last frame.
        memory_s: over what time.
        looked_s: shape (person,), in and out: for how long they have been well seen.
        leans: shape (person, segment + bone), in and out: cosines between third axes and the trunk's.
        variance: shape (person, segment + bone), in and out: of these cosines over time.
        upright: shape (person, 3), in and out: the trunk's third axis.
    """
    segments = turns.shape[1]
    for p in range(firm.shape[0]):
        if not firm[p]:
            continue
        looked_s[p] += dt_s
        share = max(dt_s / memory_s, dt_s / looked_s[p]) if looked_s[p] > 0.0 else 1.0
        share = min(share, 1.0)
        x, y, z = turns[p, 0, 0, 2], turns[p, 0, 1, 2], turns[p, 0, 2, 2]
        upright[p, 0] += share * (x - upright[p, 0])
        upright[p, 1] += share * (y - upright[p, 1])
        upright[p, 2] += share * (z - upright[p, 2])
        for i in range(leans.shape[1]):
            axes = turns[p, i] if i < segments else bones[p, i - segments]
            off = axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z - leans[p, i]
            leans[p, i] += share * off
            variance[p, i] += share * ((1.0 - share) * off * off - variance[p, i])


@kernel
def note_lowest(points, up, firm, dt_s, memory_s, stood_s, low, variance):
    """Means over the last ``memory_s`` of how high the lowest point is of people who are well seen.

    Args:
        points: shape (person, keypoint, 3), m; NaN where there is none.
        up: shape (3,): a unit vector.
        firm: shape (person,), bool: who is well seen.
        dt_s: since the last frame.
        memory_s: over what time.
        stood_s: shape (person,), in and out: for how long they have been well seen.
        low: shape (person,), in and out: along ``up``, m.
        variance: shape (person,), in and out: of that over time, m^2.
    """
    for p in range(firm.shape[0]):
        least = math.inf
        for k in range(points.shape[1]):
            height = up[0] * points[p, k, 0] + up[1] * points[p, k, 1] + up[2] * points[p, k, 2]
            least = height if height < least else least
        if not firm[p] or least == math.inf:
            continue
        stood_s[p] += dt_s
        share = max(dt_s / memory_s, dt_s / stood_s[p]) if stood_s[p] > 0.0 else 1.0
        share = min(share, 1.0)
        off = least - low[p]
        low[p] += share * off
        variance[p] += share * ((1.0 - share) * off * off - variance[p])


@kernel
def find_lowest(body, state, up, row):
    """How high the lowest point of the first person is, m, and how that goes with their pose.

    Args:
        body: a Body.
        state: a State.
        up: shape (3,): a unit vector.
        row: shape (pose,), written: m for each unit.
    """
    b = body
    nodes = np.empty((b.parents.shape[0], 3))
    jacobian = np.zeros((b.parents.shape[0], 3, row.shape[0] + state.shape.shape[1]))
    turns, bones, shape = state.turns[0], state.bones[0], state.shape[0]
    locate(b.parents, b.movers, b.is_bone, b.places, b.shape_of, b.signs, state.root[0], turns, bones, shape, nodes)
    differentiate(
        b.parents, b.movers, b.is_bone, b.places, b.shape_of, b.signs, row.shape[0], turns, bones, shape, jacobian
    )
    least = math.inf
    for k in range(b.keypoint_nodes.shape[0]):
        node = b.keypoint_nodes[k]
        if node < 0:
            continue
        height = up[0] * nodes[node, 0] + up[1] * nodes[node, 1] + up[2] * nodes[node, 2]
        if height < least:
            least = height
            for c in range(row.shape[0]):
                row[c] = up[0] * jacobian[node, 0, c] + up[1] * jacobian[node, 1, c] + up[2] * jacobian[node, 2, c]
    return least
