"""Stick meshes of an animation skeleton, for programs that display only meshes."""

from dataclasses import dataclass

import numpy as np

from posefuse.io.results.clips import BODY_TO_Y_UP, rest_root_m
from posefuse.model.animation_figures import Figure

_RING, _THICKNESS, _DOT = 0.15, 0.08, 0.06
"""Position and radius of a stick's thickest part relative to its length, and the size of a dot."""
_MAX_STICKS = 6
"""A joint with more end points than this, such as those of a face, shows them as dots."""


@dataclass(frozen=True)
class Sticks:
    """Triangles of sticks.

    Attributes:
        vertices_m: shape (3 triangle, 3): vertices in the rest pose, y up.
        normals: shape (3 triangle, 3).
        joints: shape (3 triangle,), int64: the joint that moves each vertex.
    """

    vertices_m: np.ndarray
    normals: np.ndarray
    joints: np.ndarray


def sticks_of(figure: Figure) -> dict[str, Sticks]:
    """Return the sticks of the ``left``, ``right`` and ``middle`` side; a side without sticks is left out.

    Each stick connects a joint with a child joint and moves with the former.
    """
    positions = figure.rest_m @ BODY_TO_Y_UP.T + rest_root_m(figure)
    size = float(np.ptp(positions, axis=0).max())
    triangles_by_side: dict[str, list[tuple[np.ndarray, int]]] = {}
    for j, joint in enumerate(figure.joints):
        points = [c for c in figure.children(j) if not figure.joints[c].turns]
        for child in figure.children(j):
            start, end = positions[j], positions[child]
            if child in points and len(points) > _MAX_STICKS:
                half = np.array([0.0, 0.5 * _DOT * 0.1 * size, 0.0])
                start, end = end - half, end + half
            if np.linalg.norm(end - start) > 1e-6 * size:
                triangles_by_side.setdefault(_side(joint.name, figure.joints[child].name), []).append(
                    (_stick(start, end), j)
                )
    return {side: _joined(sticks) for side, sticks in triangles_by_side.items()}


def _side(*names: str) -> str:
    for side in ("left", "right"):
        if any(name.startswith(f"{side}_") for name in names):
            return side
    return "middle"


def _stick(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the triangles of an elongated octahedron, counterclockwise from outside, shape (8, 3, 3)."""
    along = end - start
    length = float(np.linalg.norm(along))
    first = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    first *= _THICKNESS * length / np.linalg.norm(first)
    second = np.cross(along / length, first)
    ring = start + _RING * along + np.array([first, second, -first, -second])
    near = [(start, ring[(i + 1) % 4], ring[i]) for i in range(4)]
    far = [(end, ring[i], ring[(i + 1) % 4]) for i in range(4)]
    return np.array([*near, *far])


def _joined(sticks: list[tuple[np.ndarray, int]]) -> Sticks:
    triangles = np.concatenate([triangle for triangle, _ in sticks])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    joints = np.repeat([joint for _, joint in sticks], [3 * len(triangle) for triangle, _ in sticks])
    return Sticks(triangles.reshape(-1, 3), np.repeat(normals, 3, axis=0), joints)
