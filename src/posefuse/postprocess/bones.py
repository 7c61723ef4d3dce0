"""Bones of one length: from the root outwards each bone keeps its direction and gets its usual length."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posefuse.skeleton.skeletons import Skeleton

_ROOTS = ("mid_hip", "pelvis")


@dataclass(frozen=True, eq=False)
class Bones:
    """The bones of everybody.

    Attributes:
        links: shape (bone, 2), int64: near and far keypoint, bones nearer to the root first.
        length_m: shape (person, bone), NaN where it was never seen.
    """

    links: np.ndarray
    length_m: np.ndarray


def usual_bones(parts: Iterable[np.ndarray], skeleton: Skeleton) -> Bones:
    """The median length of every bone of everybody.

    Args:
        parts: positions, each of shape (frame, person, keypoint, 3), NaN where missing.
        skeleton: whose edges are the bones.
    """
    links = hierarchy(skeleton)
    lengths = np.concatenate(
        [np.linalg.norm(part[:, :, links[:, 0]] - part[:, :, links[:, 1]], axis=-1) for part in parts]
    )
    seen = np.isfinite(lengths).any(axis=0)
    middle = np.full(lengths.shape[1:], np.nan)
    middle[seen] = np.nanmedian(lengths[:, seen], axis=0)
    return Bones(links, middle)


def hierarchy(skeleton: Skeleton) -> np.ndarray:
    """The edges as a tree from the root outwards, shape (bone, 2), int64: near and far keypoint.

    The root is the middle of the hips where there is such a keypoint, else the one with most edges. An edge that
    closes a ring is no bone; what no edge joins to the root hangs on a root of its own.
    """
    neighbours: list[list[int]] = [[] for _ in skeleton.keypoints]
    for a, b in skeleton.edge_indices.tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    by_edges = sorted(range(len(neighbours)), key=lambda k: -len(neighbours[k]))
    roots = [skeleton.index(name) for name in _ROOTS if name in skeleton.keypoints] + by_edges
    links: list[tuple[int, int]] = []
    reached: set[int] = set()
    for root in roots:
        if root in reached:
            continue
        reached.add(root)
        order = [root]
        for here in order:
            for far in neighbours[here]:
                if far not in reached:
                    reached.add(far)
                    order.append(far)
                    links.append((here, far))
    return np.array(links, dtype=np.int64).reshape(-1, 2)


def make_rigid(points_m: np.ndarray, bones: Bones) -> np.ndarray:
    """Points at the ends of bones of one length.

    A point whose near end is missing stays where it is, and what hangs on it follows it.

    Args:
        points_m: shape (frame, person, keypoint, 3).
        bones: of these people.

    Returns:
        Points, likewise.
    """
    out = points_m.copy()
    for b, (near, far) in enumerate(bones.links):
        along = points_m[:, :, far] - points_m[:, :, near]
        length = np.linalg.norm(along, axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = out[:, :, near] + along * (bones.length_m[:, b] / length)[..., None]
        out[:, :, far] = np.where(np.isfinite(moved), moved, points_m[:, :, far])
    return out
