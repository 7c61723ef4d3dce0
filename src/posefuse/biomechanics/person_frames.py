"""Axes of a person in every frame: vertical, and horizontal along the line between the hips.

The root coordinates of the anatomical model are then small for people who stand, whatever direction they face, and
pelvis tilt and list have their clinical meaning (Baker 2001, J Biomech 34(2)).
"""

import numpy as np

_LINES = (("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"))


def model_world(up: np.ndarray) -> np.ndarray:
    """Return the rotation from the world to axes with y up, shape (3, 3)."""
    y = np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
    x = np.eye(3)[int(np.argmax(np.abs(y) < 0.9))]
    x = x - (x @ y) * y
    x /= np.linalg.norm(x)
    return np.stack([x, y, np.cross(x, y)])


def headings(points_m: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Return the angles about y by which a person is turned from facing x, shape (frame,), rad.

    Frames that do not show them have that of the nearest earlier frame, or the first one.

    Args:
        points_m: shape (frame, keypoint, 3), y up.
        names: names of the keypoints.
    """
    to_right = np.full((len(points_m), 2), np.nan)
    for left, right in _LINES:
        if left in names and right in names:
            line = (points_m[:, names.index(right)] - points_m[:, names.index(left)])[:, [0, 2]]
            use = np.isnan(to_right).any(axis=1) & (np.linalg.norm(line, axis=1) > 0.03)
            to_right[use] = line[use]
    known = np.isfinite(to_right).all(axis=1)
    if not known.any():
        return np.zeros(len(points_m))
    angle = np.arctan2(to_right[known, 0], to_right[known, 1])
    latest = np.maximum(np.cumsum(known) - 1, 0)
    return angle[latest]


def about_y(angle: np.ndarray) -> np.ndarray:
    """Return rotations about y, shape (..., 3, 3)."""
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.stack([c, zero, s, zero, one, zero, -s, zero, c], axis=-1).reshape(*np.shape(angle), 3, 3)


def upright_direction(points_m: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Return the median direction of a person's trunk, shape (3,), for worlds without a known vertical."""
    middle = [
        0.5 * (points_m[:, names.index(a)] + points_m[:, names.index(b)]) if a in names and b in names else None
        for a, b in _LINES
    ]
    if middle[0] is None or middle[1] is None:
        return np.array([0.0, 0.0, 1.0])
    trunk = middle[1] - middle[0]
    trunk = trunk[np.isfinite(trunk).all(axis=1)]
    mean = np.median(trunk / np.linalg.norm(trunk, axis=1, keepdims=True), axis=0) if len(trunk) else np.zeros(3)
    return mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 0.5 else np.array([0.0, 0.0, 1.0])
