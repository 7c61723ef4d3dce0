"""Sticks that show a figure: what is drawn of it where a program draws meshes only."""

from dataclasses import dataclass

import numpy as np

from posefuse.io.results.clips import BODY_TO_Y_UP, standing_m
from posefuse.model.animation_figures import Figure

_RING, _THICK, _DOT = 0.15, 0.08, 0.06
"""Of a stick's length: how far on it is thickest, and by how much; of a dot's, where a stick would be one of many."""
_MOST_STICKS = 6
"""A joint that carries more points than this, a face, shows them as dots."""


@dataclass(frozen=True)
class Sticks:
    """Triangles of sticks.

    Attributes:
        places_m: shape (3 triangle, 3): corners at rest, y up.
        normals: shape (3 triangle, 3).
        joints: shape (3 triangle,), int64: the joint that carries each corner.
    """

    places_m: np.ndarray
    normals: np.ndarray
    joints: np.ndarray


def sticks_of(figure: Figure) -> dict[str, Sticks]:
    """The sticks of a figure's ``left``, ``right`` and ``middle``; a side that has none is left out.

    Each goes from a joint to one that it carries and moves as the former does.
    """
    places = figure.rest_m @ BODY_TO_Y_UP.T + standing_m(figure)
    size = float(np.ptp(places, axis=0).max())
    found: dict[str, list[tuple[np.ndarray, int]]] = {}
    for j, joint in enumerate(figure.joints):
        points = [c for c in figure.children(j) if not figure.joints[c].turns]
        for child in figure.children(j):
            start, end = places[j], places[child]
            if child in points and len(points) > _MOST_STICKS:
                half = np.array([0.0, 0.5 * _DOT * 0.1 * size, 0.0])
                start, end = end - half, end + half
            if np.linalg.norm(end - start) > 1e-6 * size:
                found.setdefault(_side(joint.name, figure.joints[child].name), []).append((_stick(start, end), j))
    return {side: _joined(sticks) for side, sticks in found.items()}


def _side(*names: str) -> str:
    for side in ("left", "right"):
        if any(name.startswith(f"{side}_") for name in names):
            return side
    return "middle"


def _stick(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Shape (8, 3, 3): triangles of a long octahedron, seen from outside against the clock."""
    along = end - start
    length = float(np.linalg.norm(along))
    first = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    first *= _THICK * length / np.linalg.norm(first)
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
