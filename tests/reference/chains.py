"""Forward kinematics by recursion."""

import numpy as np


def positions(parents, offsets_m, turning, rotations, root_m) -> np.ndarray:
    """Shape (frame, node, 3)."""
    out = np.zeros((len(root_m), len(parents), 3))

    def place(t: int, n: int) -> tuple[np.ndarray, np.ndarray]:
        own = rotations[t, turning[n]] if turning[n] >= 0 else np.eye(3)
        if parents[n] < 0:
            return root_m[t], own
        at, orientation = place(t, parents[n])
        return at + orientation @ offsets_m[n], orientation @ own

    for t in range(len(root_m)):
        for n in range(len(parents)):
            out[t, n] = place(t, n)[0]
    return out
