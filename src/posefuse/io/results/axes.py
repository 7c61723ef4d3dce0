"""Rotations from world axes to the axes that other programs expect."""

import numpy as np

from posefuse.errors import ResultError
from posefuse.model.cameras import UpAxis

# Rows are the axes of a y-up world. From z up, this is the cyclic permutation (y, z, x) of OpenSim and Pose2Sim.
_Y_UP_FROM = {
    "z": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "y": np.eye(3),
    "x": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "-y": np.diag([1.0, -1.0, -1.0]),
    "-z": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "-x": np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
}

# The smallest rotations, which Blender (z up) inverts when it reads a file with y up.
_MINIMAL_Y_UP_FROM = {
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "y": np.eye(3),
    "x": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "-y": np.diag([1.0, -1.0, -1.0]),
    "-z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "-x": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}


def y_up_from_world(up: UpAxis | None) -> np.ndarray:
    """Return the rotation to y up, shape (3, 3); the identity if the up axis is unknown.

    Raises:
        ResultError: on an unknown axis.
    """
    return _rotation(_Y_UP_FROM, up)


def minimal_y_up_from_world(up: UpAxis | None) -> np.ndarray:
    """Return the smallest rotation to y up, shape (3, 3), as animation programs use it; from z up, (x, z, -y).

    Raises:
        ResultError: on an unknown axis.
    """
    return _rotation(_MINIMAL_Y_UP_FROM, up)


def _rotation(rotations: dict[str, np.ndarray], up: UpAxis | None) -> np.ndarray:
    if up is None:
        return np.eye(3)
    if up not in rotations:
        raise ResultError(f"The up axis {up!r} is not an axis.")
    return rotations[up]
