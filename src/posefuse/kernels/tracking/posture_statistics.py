"""Posture statistics: inclination of segments and bones from the trunk, and height of the lowest point."""

import math

import numpy as np

from posefuse.kernels.jit import kernel
from posefuse.kernels.tracking.body_kinematics import locate_nodes, node_jacobian
from posefuse.kernels.tracking.records import Pose


@kernel
def update_lean_statistics(turns, bones, reliable, dt_s, memory_s, statistics):
    """Update running means and variances of the inclination of body parts, for reliably observed people.

    The mean extends over the last ``memory_s``, or over all observations while there are fewer.

    Args:
        turns: segment rotations, shape (person, segment, 3, 3); the first segment is the trunk, its third axis points
            up.
        bones: bone frames, shape (person, bone, 3, 3).
        reliable: shape (person,), bool: whether a person is reliably observed.
        dt_s: time since the last frame.
        memory_s: time constant of the means.
        statistics: LeanStatistics, in and out.
    """
    observed_s, leans, variance, trunk_axis = statistics
    segments = turns.shape[1]
    for p in range(reliable.shape[0]):
        if not reliable[p]:
            continue
        observed_s[p] += dt_s
        weight = max(dt_s / memory_s, dt_s / observed_s[p]) if observed_s[p] > 0.0 else 1.0
        weight = min(weight, 1.0)
        x, y, z = turns[p, 0, 0, 2], turns[p, 0, 1, 2], turns[p, 0, 2, 2]
        trunk_axis[p, 0] += weight * (x - trunk_axis[p, 0])
        trunk_axis[p, 1] += weight * (y - trunk_axis[p, 1])
        trunk_axis[p, 2] += weight * (z - trunk_axis[p, 2])
        for i in range(leans.shape[1]):
            axes = turns[p, i] if i < segments else bones[p, i - segments]
            deviation = axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z - leans[p, i]
            leans[p, i] += weight * deviation
            variance[p, i] += weight * ((1.0 - weight) * deviation * deviation - variance[p, i])


@kernel
def update_height_statistics(points, up, reliable, dt_s, memory_s, observed_s, mean_height, variance):
    """Update running means and variances of the height of the lowest point, for reliably observed people.

    Args:
        points: shape (person, keypoint, 3), m; NaN where missing.
        up: shape (3,): a unit vector.
        reliable: shape (person,), bool: whether a person is reliably observed.
        dt_s: time since the last frame.
        memory_s: time constant of the means.
        observed_s: shape (person,), in and out: total time of reliable observation.
        mean_height: shape (person,), in and out: along ``up``, m.
        variance: shape (person,), in and out: variance of the height over time, m^2.
    """
    for p in range(reliable.shape[0]):
        lowest = math.inf
        for k in range(points.shape[1]):
            height = up[0] * points[p, k, 0] + up[1] * points[p, k, 1] + up[2] * points[p, k, 2]
            lowest = height if height < lowest else lowest
        if not reliable[p] or lowest == math.inf:
            continue
        observed_s[p] += dt_s
        weight = max(dt_s / memory_s, dt_s / observed_s[p]) if observed_s[p] > 0.0 else 1.0
        weight = min(weight, 1.0)
        deviation = lowest - mean_height[p]
        mean_height[p] += weight * deviation
        variance[p] += weight * ((1.0 - weight) * deviation * deviation - variance[p])


@kernel
def lowest_point(body, state, up, row):
    """Return the height of the lowest keypoint of the first person, m, and write its derivative by the pose.

    Args:
        body: a Body.
        state: a State.
        up: shape (3,): a unit vector.
        row: shape (pose,), written: m per unit.
    """
    nodes = np.empty((body.parents.shape[0], 3))
    jacobian = np.zeros((body.parents.shape[0], 3, row.shape[0] + state.shape.shape[1]))
    pose = Pose(state.root[0], state.turns[0], state.bones[0], state.shape[0])
    locate_nodes(body, pose, nodes)
    node_jacobian(body, pose, row.shape[0], jacobian)
    lowest = math.inf
    for k in range(body.keypoint_nodes.shape[0]):
        node = body.keypoint_nodes[k]
        if node < 0:
            continue
        height = up[0] * nodes[node, 0] + up[1] * nodes[node, 1] + up[2] * nodes[node, 2]
        if height < lowest:
            lowest = height
            for c in range(row.shape[0]):
                row[c] = up[0] * jacobian[node, 0, c] + up[1] * jacobian[node, 1, c] + up[2] * jacobian[node, 2, c]
    return lowest
