"""Articulated bodies: where the points of a pose are, and how they move with it.

A pose is where the root is, a rotation for each segment, and for each bone a rotation whose third axis is the bone's
direction. It changes by increments: metres for the root, radians about a segment's own axes, and for a bone radians
about the first two axes of its own frame, which is carried along and never rebuilt; a turn about the bone itself moves
nothing that can be seen. Numbers of the pose are counted in this order, the shape (lengths, in metres) comes after
them. See :class:`posefuse.skeleton.trees.Tree` for the arrays of a tree.
"""

from posefuse.kernels.jit import inline, step
from posefuse.kernels.linear_algebra.rotations import turn


@inline
def place_of(places, shape_of, signs, shape, n, i):
    """A coordinate of node ``n`` in the axes of what it rides on, metres."""
    s = shape_of[n, i]
    return signs[n, i] * shape[s] if s >= 0 else places[n, i]


@step
def locate(parents, movers, is_bone, places, shape_of, signs, root, turns, bones, shape, points):
    """Where the nodes of a body are.

    Args:
        parents, movers, is_bone, places, shape_of, signs: of the tree, see ``Tree.packed``.
        root: shape (3,), m.
        turns: shape (segment, 3, 3).
        bones: shape (bone, 3, 3).
        shape: shape (shape,), m.
        points: shape (node, 3), written.
    """
    for n in range(parents.shape[0]):
        p = parents[n]
        x = place_of(places, shape_of, signs, shape, n, 0)
        y = place_of(places, shape_of, signs, shape, n, 1)
        z = place_of(places, shape_of, signs, shape, n, 2)
        for i in range(3):
            if p < 0:
                points[n, i] = root[i]
            elif is_bone[n] != 0:
                points[n, i] = points[p, i] + z * bones[movers[n], i, 2]
            else:
                axes = turns[movers[n]]
                points[n, i] = points[p, i] + axes[i, 0] * x + axes[i, 1] * y + axes[i, 2] * z


@step
def differentiate(parents, movers, is_bone, places, shape_of, signs, n_pose, turns, bones, shape, jacobian):
    """How the nodes of a body move with its pose and its shape.

    Args:
        n_pose: how many numbers a pose has.
        jacobian: shape (node, 3, pose + shape), written.
    """
    first_bone = 3 + 3 * turns.shape[0]
    for n in range(parents.shape[0]):
        p = parents[n]
        for i in range(3):
            for c in range(jacobian.shape[2]):
                jacobian[n, i, c] = jacobian[p, i, c] if p >= 0 else (1.0 if c == i else 0.0)
        if p < 0:
            continue
        x = place_of(places, shape_of, signs, shape, n, 0)
        y = place_of(places, shape_of, signs, shape, n, 1)
        z = place_of(places, shape_of, signs, shape, n, 2)
        if is_bone[n] != 0:
            c = first_bone + 2 * movers[n]
            axes = bones[movers[n]]
            for i in range(3):
                jacobian[n, i, c] -= z * axes[i, 1]
                jacobian[n, i, c + 1] += z * axes[i, 0]
        else:
            c = 3 + 3 * movers[n]
            axes = turns[movers[n]]
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


@step
def move(change, root, turns, bones):
    """Move a pose by an increment, shape (pose,), in place."""
    for i in range(3):
        root[i] += change[i]
    for s in range(turns.shape[0]):
        turn(turns[s], change[3 + 3 * s], change[4 + 3 * s], change[5 + 3 * s])
    first = 3 + 3 * turns.shape[0]
    for b in range(bones.shape[0]):
        turn(bones[b], change[first + 2 * b], change[first + 2 * b + 1], 0.0)
