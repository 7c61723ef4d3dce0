"""Turning world axes to the axes that programs downstream expect."""

import numpy as np

from posefuse.errors import ResultError
from posefuse.model.cameras import UpAxis

# Rows: where the axes of a y-up world come from. From z up it is the cyclic (y, z, x), OpenSim's and Pose2Sim's.
_Y_UP_FROM = {
    "z": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "y": np.eye(3),
    "x": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "-y": np.diag([1.0, -1.0, -1.0]),
    "-z": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "-x": np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
}

# By the least turn: what Blender, which has z up, undoes when it reads a file with y up.
_LEAST_Y_UP_FROM = {
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "y": np.eye(3),
    "x": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "-y": np.diag([1.0, -1.0, -1.0]),
    "-z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "-x": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}


def y_up_from_world(up: UpAxis | None) -> np.ndarray:
    """Shape (3, 3): the rotation that puts up along y; the identity where nobody knows which way is up.

    Raises:
        ResultError: on an unknown axis.
    """
    return _rotation(_Y_UP_FROM, up)


def least_y_up_from_world(up: UpAxis | None) -> np.ndarray:
    """Shape (3, 3): likewise by the least turn, as programs for animation do it; from z up (x, z, -y).

    Raises:
        ResultError: on an unknown axis.
    """
    return _rotation(_LEAST_Y_UP_FROM, up)


def _rotation(rotations: dict[str, np.ndarray], up: UpAxis | None) -> np.ndarray:
    if up is None:
        return np.eye(3)
    if up not in rotations:
        raise ResultError(f"up_axis {up!r} is not an axis.")
    return rotations[up]
