"""Forward kinematics of a kinematic tree."""

from posefuse.kernels.jit import kernel


@kernel
def forward_kinematics(parents, offsets, rotation_of, rotations, root_m, positions_m, orientations):
    """Compute the positions of every node of a tree over time.

    The position of a node is that of its parent plus its offset, rotated by the orientation of the parent. Its
    orientation is that of the parent times its own rotation, if it has one.

    Args:
        parents: shape (node,), int64: index of the parent, which comes before the node; -1 for the root.
        offsets: shape (node, 3): offset from the parent, in the axes of the parent, m; ignored for the root.
        rotation_of: shape (node,), int64: index of the node's rotation in ``rotations``, -1 if it does not rotate.
        rotations: shape (frame, joint, 3, 3).
        root_m: shape (frame, 3): position of the root.
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
            joint = rotation_of[n]
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
