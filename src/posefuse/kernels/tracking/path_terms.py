"""Normal equations of the poses of one body in consecutive frames: observations with correlated errors, and motion.

Poses change by the increments of :mod:`posefuse.kernels.tracking.body_kinematics`. Errors of a keypoint in a view are a
first-order autoregressive process over consecutive frames, so frames are coupled with the next one; motion couples each
frame with the next two.
"""

import math
from typing import Any, NamedTuple

from posefuse.kernels.cameras.lens import OK
from posefuse.kernels.jit import inline, kernel, subroutine
from posefuse.kernels.linear_algebra.rotations import rotate, rotation_between
from posefuse.kernels.tracking.body_kinematics import apply_increment, locate_nodes, offset_jacobian
from posefuse.kernels.tracking.joint_limits import TWIST, add_limit, add_twist
from posefuse.kernels.tracking.point_projection import project_node, squared_px_per_m
from posefuse.kernels.tracking.records import Pose
from posefuse.kernels.tracking.smoothing import tilt_between


class LinearObservations(NamedTuple):
    """Detections linearized at the poses.

    Attributes:
        residual_px: shape (frame, view, keypoint, 2): observed minus projected.
        rows: shape (frame, view, keypoint, 2, 3): derivatives of the pixel by the point, px per m.
        precision: shape (frame, view, keypoint): inverse standard deviation of the error, weighted, 1/px; 0 for none.
        weight: shape (frame, view, keypoint): square root of the weight of the Student t distribution.
        squared: shape (frame, view, keypoint): squared error in units of the variance per axis.
        offsets: shape (frame, node, 3, 6): derivatives of the offset of each node from its parent, by the numbers in
            ``columns`` of :class:`PathScratch`.
    """

    residual_px: Any
    rows: Any
    precision: Any
    weight: Any
    squared: Any
    offsets: Any


class PathSystem(NamedTuple):
    """Normal equations of poses, and of a common shape if it has columns.

    Attributes:
        diagonal: shape (frame, m, m): blocks of each frame, lower triangles.
        next: shape (frame, m, m): row block of each frame, column block of the frame before.
        second: shape (frame, pose): diagonal of the block of each frame and the second frame before.
        gradient: shape (frame, m): negative gradient of the cost.
    """

    diagonal: Any
    next: Any
    second: Any
    gradient: Any


class PathScratch(NamedTuple):
    """Scratch arrays.

    Attributes:
        columns: shape (node, 6), int64: the numbers on which the offset of each node depends, those of the pose first;
            -1 beyond the last. It is not written.
        nodes: shape (node, 3): points.
        own, link: shape (node, 3, 3): what the keypoints that a node carries add to the equations of its point, and to
            those that link it to the frame before.
        force: shape (node, 3): what they add to the gradient.
        weighted: shape (3, 6).
    """

    columns: Any
    nodes: Any
    own: Any
    link: Any
    force: Any
    weighted: Any


@kernel
def linearize_path(cameras, body, error_model, state, keypoints_px, variance_px2, scratch, out):
    """Linearize all detections at the poses of a state with one entry per frame, and weight them.

    Args:
        cameras: the camera array.
        body: a Body.
        error_model: an ErrorModel; its floor and degrees of freedom are used.
        state: a State, with frames on the person axis.
        keypoints_px: shape (frame, view, keypoint, 2), NaN where there is none.
        variance_px2: shape (frame, view, keypoint): variance of the noise per axis, without the floor of the body.
        scratch: PathScratch.
        out: LinearObservations, written.
    """
    frames, views, keypoints = variance_px2.shape
    floor = error_model.floor_m * error_model.floor_m
    for t in range(frames):
        pose = Pose(state.root[t], state.turns[t], state.bones[t], state.shape[t])
        locate_nodes(body, pose, scratch.nodes)
        offset_jacobian(body, pose, out.offsets[t])
        for k in range(keypoints):
            node = body.keypoint_nodes[k]
            for v in range(views):
                out.precision[t, v, k] = 0.0
                u, w = keypoints_px[t, v, k, 0], keypoints_px[t, v, k, 1]
                if node < 0 or not math.isfinite(u + w):
                    continue
                view = project_node(cameras, v, scratch.nodes, node)
                if view[0] != OK:
                    continue
                du, dv = u - view[1], w - view[2]
                variance = variance_px2[t, v, k] + floor * squared_px_per_m(view)
                squared = (du * du + dv * dv) / variance
                weight = math.sqrt((error_model.nu + 2.0) / (error_model.nu + squared))
                out.residual_px[t, v, k, 0] = du
                out.residual_px[t, v, k, 1] = dv
                out.weight[t, v, k] = weight
                out.squared[t, v, k] = squared
                out.precision[t, v, k] = weight / math.sqrt(variance)
                row = out.rows[t, v, k]
                row[0, 0], row[0, 1], row[0, 2] = view[3], view[4], view[5]
                row[1, 0], row[1, 1], row[1, 2] = view[6], view[7], view[8]


@kernel
def add_observations(body, linear, innovations, scratch, system):
    """Add all detections to the equations.

    Args:
        body: a Body.
        linear: LinearObservations.
        innovations: Innovations of their errors.
        scratch: PathScratch.
        system: PathSystem, in and out.
    """
    frames, m = system.gradient.shape
    for t in range(frames):
        linked = _sum_views(body, linear, innovations, t, scratch)
        here, before = linear.offsets[t], linear.offsets[max(t - 1, 0)]
        for node in range(len(body.parents)):
            own = scratch.own[node]
            if own[0, 0] + own[1, 1] + own[2, 2] > 0.0:
                _add_gradient(node, here, scratch, m, system.gradient[t])
                _add_own(body, node, here, scratch, system.diagonal[t])
                if linked:
                    _add_link(body, node, here, before, scratch, system.next[t])


@subroutine
def _sum_views(body, linear, innovations, t, scratch):
    """Sum the detections of a frame over the keypoints that each node carries.

    Returns:
        Whether any is correlated with the one before.
    """
    own, link, force = scratch.own, scratch.link, scratch.force
    own[:] = 0.0
    link[:] = 0.0
    force[:] = 0.0
    linked = False
    for k in range(linear.precision.shape[2]):
        node = body.keypoint_nodes[k]
        if node >= 0:
            for v in range(linear.precision.shape[1]):
                if linear.precision[t, v, k] > 0.0:
                    linked |= _add_view(linear, innovations, t, v, k, own[node], link[node], force[node])
    for node in range(len(body.parents) - 1, 0, -1):
        parent = body.parents[node]
        if parent >= 0:
            for i in range(3):
                force[parent, i] += force[node, i]
                for j in range(3):
                    own[parent, i, j] += own[node, i, j]
                    link[parent, i, j] += link[node, i, j]
    return linked


@subroutine
def _add_view(linear, innovations, t, v, k, own_sum, link_sum, force):
    """Add one detection, correlated with those before and after it, to the equations of a point.

    Returns:
        Whether it is correlated with the one before.
    """
    row, residual = linear.rows[t, v, k], linear.residual_px
    own, before = innovations.own[t, v, k], innovations.before[t, v, k]
    after = innovations.before[t + 1, v, k] if t + 1 < innovations.own.shape[0] else 0.0
    d = own * own + after * after
    e, f = d * residual[t, v, k, 0], d * residual[t, v, k, 1]
    if before > 0.0:
        o = -own * before
        e += o * residual[t - 1, v, k, 0]
        f += o * residual[t - 1, v, k, 1]
        _add_outer(row, linear.rows[t - 1, v, k], o, link_sum)
    if after > 0.0:
        o = -innovations.own[t + 1, v, k] * after
        e += o * residual[t + 1, v, k, 0]
        f += o * residual[t + 1, v, k, 1]
    _add_outer(row, row, d, own_sum)
    for i in range(3):
        force[i] += row[0, i] * e + row[1, i] * f
    return before > 0.0


@inline
def _add_outer(left, right, factor, out):
    """Add ``factor left^T right`` of two matrices of two rows."""
    for i in range(3):
        for j in range(3):
            out[i, j] += factor * (left[0, i] * right[0, j] + left[1, i] * right[1, j])


@inline
def _column(columns, node, p, m):
    """Return the place of the ``p``-th number of a node among the ``m`` unknowns, or -1."""
    i = columns[node, p] if p < columns.shape[1] else -1
    return i if i < m else -1


@subroutine
def _add_gradient(node, offsets, scratch, m, gradient):
    """Add the force on the keypoints that a node carries."""
    force, offset = scratch.force[node], offsets[node]
    p, i = 0, _column(scratch.columns, node, 0, m)
    while i >= 0:
        gradient[i] += offset[0, p] * force[0] + offset[1, p] * force[1] + offset[2, p] * force[2]
        p += 1
        i = _column(scratch.columns, node, p, m)


@subroutine
def _weigh(inner, offset, transposed, weighted):
    """Write ``inner offset``, or ``inner^T offset``."""
    for i in range(3):
        x, y, z = inner[i, 0], inner[i, 1], inner[i, 2]
        if transposed:
            x, y, z = inner[0, i], inner[1, i], inner[2, i]
        for c in range(offset.shape[1]):
            weighted[i, c] = x * offset[0, c] + y * offset[1, c] + z * offset[2, c]


@subroutine
def _add_own(body, node, offsets, scratch, out):
    """Add the products of the offset of a node with itself and with those on its way to the root, lower triangle."""
    _weigh(scratch.own[node], offsets[node], False, scratch.weighted)
    _add_pair(node, node, offsets, scratch, True, False, True, out)
    other = body.parents[node]
    while other >= 0:
        _add_pair(node, other, offsets, scratch, True, True, True, out)
        other = body.parents[other]


@subroutine
def _add_link(body, node, here, before, scratch, out):
    """Add the same for rows of this frame and columns of the frame before, all entries."""
    _weigh(scratch.link[node], here[node], True, scratch.weighted)
    other = node
    while other >= 0:
        _add_pair(node, other, before, scratch, True, False, False, out)
        other = body.parents[other]
    _weigh(scratch.link[node], before[node], False, scratch.weighted)
    other = body.parents[node]
    while other >= 0:
        _add_pair(node, other, here, scratch, False, True, False, out)
        other = body.parents[other]


@subroutine
def _add_pair(node, other, offsets, scratch, rows, columns, lower, out):
    """Add the products of the weighted offset of a node with that of another one.

    Args:
        node: the node whose weighted offset is in ``scratch``.
        other: the other node.
        offsets: shape (node, 3, 6).
        scratch: PathScratch.
        rows: whether to add them to the rows of the node and the columns of the other one.
        columns: whether to add them to the columns of the node and the rows of the other one.
        lower: whether to leave out entries above the diagonal.
        out: shape (m, m), in and out.
    """
    weighted, right, m = scratch.weighted, offsets[other], out.shape[0]
    p, i = 0, _column(scratch.columns, node, 0, m)
    while i >= 0:
        q, j = 0, _column(scratch.columns, other, 0, m)
        while j >= 0:
            value = weighted[0, p] * right[0, q] + weighted[1, p] * right[1, q] + weighted[2, p] * right[2, q]
            if rows and (i >= j or not lower):
                out[i, j] += value
            if columns and (j >= i or not lower):
                out[j, i] += value
            q += 1
            j = _column(scratch.columns, other, q, m)
        p += 1
        i = _column(scratch.columns, node, p, m)


@kernel
def add_limits(body, stiffness, state, system):
    """Add the joint limits of each frame to the equations."""
    for t in range(state.root.shape[0]):
        hessian, gradient = system.diagonal[t], system.gradient[t]
        for limit in range(body.limits.shape[0]):
            if body.limits[limit, 0] == TWIST:
                add_twist(body, limit, stiffness, state.turns[t], hessian, gradient)
            else:
                add_limit(body, limit, stiffness, state.turns[t], state.bones[t], hessian, gradient)


@kernel
def align_bones(bones):
    """Turn the frame of each bone about the bone, so that it turns as little as possible from frame to frame.

    Then the increments of consecutive frames have common axes.

    Args:
        bones: shape (frame, bone, 3, 3), in and out.
    """
    for b in range(bones.shape[1]):
        for t in range(1, bones.shape[0]):
            x, y = tilt_between(bones[t - 1, b], bones[t, b])
            for i in range(3):
                for j in range(3):
                    bones[t, b, i, j] = bones[t - 1, b, i, j]
            rotate(bones[t, b], x, y, 0.0)


@kernel
def pose_differences(state, out):
    """Write the increment from each frame to the next, shape (frame - 1, pose)."""
    first = 3 + 3 * state.turns.shape[1]
    for t in range(out.shape[0]):
        for i in range(3):
            out[t, i] = state.root[t + 1, i] - state.root[t, i]
        for s in range(state.turns.shape[1]):
            c = 3 + 3 * s
            out[t, c], out[t, c + 1], out[t, c + 2] = rotation_between(state.turns[t, s], state.turns[t + 1, s])
        for b in range(state.bones.shape[1]):
            c = first + 2 * b
            out[t, c], out[t, c + 1] = tilt_between(state.bones[t, b], state.bones[t + 1, b])


@kernel
def add_motion(coefficients, information, deviation, system):
    """Add the motion prior: a combination of three consecutive frames is near zero.

    Args:
        coefficients: shape (row, 3, pose): derivatives of each deviation by the poses of its three frames.
        information: shape (row, pose): inverse variance of the deviations.
        deviation: shape (row, pose).
        system: PathSystem, in and out.
    """
    for t in range(deviation.shape[0]):
        for i in range(deviation.shape[1]):
            w = information[t, i]
            a, b, c = coefficients[t, 0, i], coefficients[t, 1, i], coefficients[t, 2, i]
            e = w * deviation[t, i]
            system.gradient[t, i] -= a * e
            system.gradient[t + 1, i] -= b * e
            system.gradient[t + 2, i] -= c * e
            system.diagonal[t, i, i] += w * a * a
            system.diagonal[t + 1, i, i] += w * b * b
            system.diagonal[t + 2, i, i] += w * c * c
            system.next[t + 1, i, i] += w * a * b
            system.next[t + 2, i, i] += w * b * c
            system.second[t + 2, i] += w * a * c


@kernel
def move_poses(step, state):
    """Apply an increment to each frame, shape (frame, at least pose)."""
    n = state.velocity.shape[1]
    for t in range(step.shape[0]):
        apply_increment(step[t, :n], state.root[t], state.turns[t], state.bones[t])
