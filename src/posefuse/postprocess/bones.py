"""Make bone lengths constant: from the root outward, each bone keeps its direction and gets its median length."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posefuse.skeleton.skeletons import Skeleton

_ROOTS = ("mid_hip", "pelvis")


@dataclass(frozen=True, eq=False)
class Bones:
    """Hold the bones of all people.

    Attributes:
        links: shape (bone, 2), int64: near and far keypoint, bones closer to the root first.
        length_m: shape (person, bone), NaN without observations.
    """

    links: np.ndarray
    length_m: np.ndarray


def median_bones(parts: Iterable[np.ndarray], skeleton: Skeleton) -> Bones:
    """Return the median length of every bone of every person.

    Args:
        parts: positions, each of shape (frame, person, keypoint, 3), NaN where missing.
        skeleton: its edges are the bones.
    """
    links = hierarchy(skeleton)
    lengths = np.concatenate(
        [np.linalg.norm(part[:, :, links[:, 0]] - part[:, :, links[:, 1]], axis=-1) for part in parts]
    )
    seen = np.isfinite(lengths).any(axis=0)
    median = np.full(lengths.shape[1:], np.nan)
    median[seen] = np.nanmedian(lengths[:, seen], axis=0)
    return Bones(links, median)


def hierarchy(skeleton: Skeleton) -> np.ndarray:
    """Return the edges as a tree from the root outward, shape (bone, 2), int64: near and far keypoint.

    The root is the mid-hip if there is such a keypoint, otherwise the keypoint with the most edges. Edges that close a
    cycle are ignored; keypoints not connected to the root form trees of their own.
    """
    neighbors: list[list[int]] = [[] for _ in skeleton.keypoints]
    for a, b in skeleton.edge_indices.tolist():
        neighbors[a].append(b)
        neighbors[b].append(a)
    by_edges = sorted(range(len(neighbors)), key=lambda k: -len(neighbors[k]))
    roots = [skeleton.index(name) for name in _ROOTS if name in skeleton.keypoints] + by_edges
    links: list[tuple[int, int]] = []
    reached: set[int] = set()
    for root in roots:
        if root in reached:
            continue
        reached.add(root)
        order = [root]
        for near in order:
            for far in neighbors[near]:
                if far not in reached:
                    reached.add(far)
                    order.append(far)
                    links.append((near, far))
    return np.array(links, dtype=np.int64).reshape(-1, 2)


def make_rigid(points_m: np.ndarray, bones: Bones) -> np.ndarray:
    """Return points with constant bone lengths.

    A point whose near end is missing keeps its position, and its descendants follow it.

    Args:
        points_m: shape (frame, person, keypoint, 3).
        bones: of these people.

    Returns:
        Points of the same shape.
    """
    out = points_m.copy()
    for b, (near, far) in enumerate(bones.links):
        direction = points_m[:, :, far] - points_m[:, :, near]
        length = np.linalg.norm(direction, axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            new_position = out[:, :, near] + direction * (bones.length_m[:, b] / length)[..., None]
        out[:, :, far] = np.where(np.isfinite(new_position), new_position, points_m[:, :, far])
    return out
