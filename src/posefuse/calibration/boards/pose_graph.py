"""Initial poses of cameras that see a board together, from a graph of the relative poses of pairs.

The relative pose of two cameras is the median of those of all frames in which both see the board. A spanning tree of
the pairs with the most frames connects the cameras.
"""

from dataclasses import dataclass

import numpy as np

MIN_SHARED = 3
"""Least number of frames in which two cameras see the board to be connected."""

_MAX_FRAMES = 60


@dataclass(frozen=True, eq=False)
class ViewPoses:
    """Poses of the board in the coordinates of one camera.

    Attributes:
        frames: shape (image,), int64, ascending: index of the frame.
        rotations: shape (image, 3, 3): camera from board.
        translations_m: shape (image, 3).
    """

    frames: np.ndarray
    rotations: np.ndarray
    translations_m: np.ndarray


@dataclass(frozen=True, eq=False)
class CameraGraph:
    """How cameras are connected by frames of the board.

    Attributes:
        shared: shape (view, view), int64: number of frames in which two cameras see the board.
        groups: views of each connected group, the largest first.
        rotations: shape (view, 3, 3): camera from world, where the world is the first camera of the first group; NaN
            for cameras of other groups.
        translations_m: shape (view, 3).
    """

    shared: np.ndarray
    groups: tuple[tuple[int, ...], ...]
    rotations: np.ndarray
    translations_m: np.ndarray


def connect(views: list[ViewPoses]) -> CameraGraph:
    """Connect cameras by the frames that they share.

    Args:
        views: poses of the board in each camera.
    """
    n = len(views)
    shared = np.array([[len(np.intersect1d(a.frames, b.frames)) for b in views] for a in views])
    rotations, translations = np.full((n, 3, 3), np.nan), np.full((n, 3), np.nan)
    groups: list[tuple[int, ...]] = []
    left = list(range(n))
    while left:
        # The camera with the most shared frames is the first of its group.
        root = max(left, key=lambda v: (sum(shared[v, u] for u in left if u != v), -v))
        group, poses = _tree(root, left, shared, views)
        groups.append(tuple(sorted(group)))
        left = [v for v in left if v not in group]
        if len(groups[-1]) == max(len(g) for g in groups) and np.isnan(rotations).all():
            for v, (rotation, translation) in zip(group, poses, strict=True):
                rotations[v], translations[v] = rotation, translation
    groups.sort(key=lambda group: (-len(group), group))
    return CameraGraph(shared, tuple(groups), rotations, translations)


def _tree(
    root: int, left: list[int], shared: np.ndarray, views: list[ViewPoses]
) -> tuple[list[int], list[tuple[np.ndarray, np.ndarray]]]:
    """Return the cameras connected to one camera in the order of a spanning tree, and their poses."""
    group, poses = [root], [(np.eye(3), np.zeros(3))]
    while True:
        edges = [
            (int(shared[a, b]), a, b) for a in group for b in left if b not in group and shared[a, b] >= MIN_SHARED
        ]
        if not edges:
            return group, poses
        _, a, b = max(edges, key=lambda edge: (edge[0], -edge[1], -edge[2]))
        rotation, translation = relative_pose(views[a], views[b])
        of_a = poses[group.index(a)]
        group.append(b)
        poses.append((rotation @ of_a[0], rotation @ of_a[1] + translation))


def relative_pose(a: ViewPoses, b: ViewPoses) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose of camera a in camera b (rotation, translation): the medoid over the frames that both share."""
    _, in_a, in_b = np.intersect1d(a.frames, b.frames, return_indices=True)
    if len(in_a) > _MAX_FRAMES:
        chosen = np.linspace(0, len(in_a) - 1, _MAX_FRAMES).astype(np.int64)
        in_a, in_b = in_a[chosen], in_b[chosen]
    rotations = b.rotations[in_b] @ a.rotations[in_a].transpose(0, 2, 1)
    translations = b.translations_m[in_b] - (rotations @ a.translations_m[in_a][:, :, None])[:, :, 0]
    reach = max(float(np.median(np.linalg.norm(a.translations_m, axis=1))), 1e-9)
    cost = np.zeros(len(rotations))
    for k, rotation in enumerate(rotations):
        cosine = 0.5 * (np.einsum("nij,ij->n", rotations, rotation) - 1.0)
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        cost[k] = (angle + np.linalg.norm(translations - translations[k], axis=1) / reach).sum()
    best = int(np.argmin(cost))
    return rotations[best], translations[best]
