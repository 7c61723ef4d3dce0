"""Forward kinematics of articulated bodies and its derivatives.

A pose consists of the root position, a rotation for each segment, and for each bone a rotation whose third axis is the
direction of the bone. It changes by increments: meters for the root, radians about the axes of a segment, and for a
bone radians about the first two axes of its frame. The frame of a bone is carried along and never rebuilt; a rotation
about the bone itself has no visible effect. The numbers of the pose have this order; the shape (lengths, in meters)
follows. See :class:`posefuse.skeleton.trees.Tree` for the arrays of a tree.
"""

from posefuse.kernels.jit import inline, subroutine
from posefuse.kernels.linear_algebra.rotations import rotate


@inline
def _offset_of(offsets, shape_of, signs, shape, n, i):
    """Return a coordinate of node ``n`` in the axes of its carrier, in meters."""
    s = shape_of[n, i]
    return signs[n, i] * shape[s] if s >= 0 else offsets[n, i]


@subroutine
def locate_nodes(body, pose, points):
    """Compute the positions of the nodes of a body.

    Args:
        body: a Body.
        pose: a Pose.
        points: shape (node, 3), written.
    """
    parents, carriers, is_bone = body.parents, body.carriers, body.is_bone
    offsets, shape_of, signs = body.offsets, body.shape_of, body.signs
    root, turns, bones, shape = pose
    for n in range(parents.shape[0]):
        p = parents[n]
        x = _offset_of(offsets, shape_of, signs, shape, n, 0)
        y = _offset_of(offsets, shape_of, signs, shape, n, 1)
        z = _offset_of(offsets, shape_of, signs, shape, n, 2)
        for i in range(3):
            if p < 0:
                points[n, i] = root[i]
            elif is_bone[n] != 0:
                points[n, i] = points[p, i] + z * bones[carriers[n], i, 2]
            else:
                axes = turns[carriers[n]]
                points[n, i] = points[p, i] + axes[i, 0] * x + axes[i, 1] * y + axes[i, 2] * z


@subroutine
def node_jacobian(body, pose, n_pose, jacobian):
    """Compute the derivatives of the node positions by pose and shape.

    Args:
        body: a Body.
        pose: a Pose.
        n_pose: number of pose numbers.
        jacobian: shape (node, 3, pose + shape), written.
    """
    parents, carriers, is_bone = body.parents, body.carriers, body.is_bone
    offsets, shape_of, signs = body.offsets, body.shape_of, body.signs
    turns, bones, shape = pose.turns, pose.bones, pose.shape
    first_bone = 3 + 3 * turns.shape[0]
    for n in range(parents.shape[0]):
        p = parents[n]
        for i in range(3):
            for c in range(jacobian.shape[2]):
                jacobian[n, i, c] = jacobian[p, i, c] if p >= 0 else (1.0 if c == i else 0.0)
        if p < 0:
            continue
        x = _offset_of(offsets, shape_of, signs, shape, n, 0)
        y = _offset_of(offsets, shape_of, signs, shape, n, 1)
        z = _offset_of(offsets, shape_of, signs, shape, n, 2)
        if is_bone[n] != 0:
            c = first_bone + 2 * carriers[n]
            axes = bones[carriers[n]]
            for i in range(3):
                jacobian[n, i, c] -= z * axes[i, 1]
                jacobian[n, i, c + 1] += z * axes[i, 0]
        else:
            c = 3 + 3 * carriers[n]
            axes = turns[carriers[n]]
            for i in range(3):
                # (a, b, c) x (x, y, z), in the segment's axes.
                jacobian[n, i, c] += axes[i, 2] * y - axes[i, 1] * z
                jacobian[n, i, c + 1] += axes[i, 0] * z - axes[i, 2] * x
                jacobian[n, i, c + 2] += axes[i, 1] * x - axes[i, 0] * y
        for axis in range(3):
            s = shape_of[n, axis]
            if s >= 0:
                for i in range(3):
                    jacobian[n, i, n_pose + s] += signs[n, axis] * axes[i, axis]


@subroutine
def offset_jacobian(body, pose, jacobian):
    """Compute the derivatives of the offset of each node from its parent; those of a root are of its position.

    A node moves with all offsets on its way to the root.

    Args:
        body: a Body.
        pose: a Pose.
        jacobian: shape (node, 3, 6), written: derivatives by the root or the increments of the carrier, then by lengths
            along the axes of the carrier, as many as there are.
    """
    offsets, shape_of, signs = body.offsets, body.shape_of, body.signs
    for n in range(body.parents.shape[0]):
        columns = jacobian[n]
        if body.parents[n] < 0:
            for i in range(3):
                for j in range(3):
                    columns[i, j] = 1.0 if i == j else 0.0
            continue
        x = _offset_of(offsets, shape_of, signs, pose.shape, n, 0)
        y = _offset_of(offsets, shape_of, signs, pose.shape, n, 1)
        z = _offset_of(offsets, shape_of, signs, pose.shape, n, 2)
        bone = body.is_bone[n] != 0
        axes = pose.bones[body.carriers[n]] if bone else pose.turns[body.carriers[n]]
        for i in range(3):
            if bone:
                columns[i, 0] = -z * axes[i, 1]
                columns[i, 1] = z * axes[i, 0]
            else:
                columns[i, 0] = axes[i, 2] * y - axes[i, 1] * z
                columns[i, 1] = axes[i, 0] * z - axes[i, 2] * x
                columns[i, 2] = axes[i, 1] * x - axes[i, 0] * y
        c = 2 if bone else 3
        for axis in range(3):
            if shape_of[n, axis] >= 0:
                for i in range(3):
                    columns[i, c] = signs[n, axis] * axes[i, axis]
                c += 1


@subroutine
def apply_increment(change, root, turns, bones):
    """Apply an increment, shape (pose,), to a pose in place."""
    for i in range(3):
        root[i] += change[i]
    for s in range(turns.shape[0]):
        rotate(turns[s], change[3 + 3 * s], change[4 + 3 * s], change[5 + 3 * s])
    first = 3 + 3 * turns.shape[0]
    for b in range(bones.shape[0]):
        rotate(bones[b], change[first + 2 * b], change[first + 2 * b + 1], 0.0)
