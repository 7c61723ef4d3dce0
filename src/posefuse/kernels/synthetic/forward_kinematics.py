"""Forward kinematics of a kinematic tree."""

from posefuse.kernels.jit import kernel


@kernel
def forward_kinematics(parents, offsets, turning, rotations, root_m, positions_m, orientations):
    """Positions of every node of a tree over time.

    A node stands at its parent's position plus its offset, turned by the parent's orientation; its own orientation is
    the parent's times its own rotation, if it has one.

    Args:
        parents: shape (node,), int64: place of the parent, which comes before; -1 for the root.
        offsets: shape (node, 3): from the parent, in the parent's axes, m; ignored for the root.
        turning: shape (node,), int64: which of ``rotations`` is the node's own, -1 where it does not turn.
        rotations: shape (frame, joint, 3, 3).
        root_m: shape (frame, 3): where the root is.
        positions_m: shape (frame, node, 3), written.
        orientations: shape (node, 3, 3), scratch.
    """
    for t in range(root_m.shape[0]):
        for n in range(parents.shape[0]):
            p = parents[n]
            for i in range(3):
                if p < 0:
                    positions_m[t, n, i] = root_m[t, i]
                else:
                    positions_m[t, n, i] = (
                        positions_m[t, p, i]
                        + orientations[p, i, 0] * offsets[n, 0]
                        + orientations[p, i, 1] * offsets[n, 1]
                        + orientations[p, i, 2] * offsets[n, 2]
                    )
            joint = turning[n]
            for i in range(3):
                for j in range(3):
                    if p < 0:
                        orientations[n, i, j] = rotations[t, joint, i, j] if joint >= 0 else (1.0 if i == j else 0.0)
                    elif joint < 0:
                        orientations[n, i, j] = orientations[p, i, j]
                    else:
                        orientations[n, i, j] = (
                            orientations[p, i, 0] * rotations[t, joint, 0, j]
                            + orientations[p, i, 1] * rotations[t, joint, 1, j]
                            + orientations[p, i, 2] * rotations[t, joint, 2, j]
                        )
