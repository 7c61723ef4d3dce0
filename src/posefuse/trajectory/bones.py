"""Bones of the trajectory solve: edges of the skeleton, and the forest along which information propagates."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from posefuse.kernels.trajectory.bone_terms import Components
from posefuse.skeleton.skeletons import Skeleton

_MIN_BATCH = 16
"""Minimum number of keypoints that are solved together."""


@dataclass(frozen=True, eq=False)
class Bones:
    """Pairs of connected keypoints.

    Attributes:
        ends: shape (bone, 2), int64.
        order: shape (tree bone, 2), int64: bones of a forest, those nearest to a root first, and which end is outer.
        rigid: shape (bone,), bool: whether the skeleton declares the bone rigid.
        components: groups of keypoints that the bones connect; a keypoint without bones is a group of its own.
    """

    ends: np.ndarray
    order: np.ndarray
    rigid: np.ndarray
    components: Components

    @classmethod
    def none(cls, keypoints: int) -> Self:
        """Return a record without bones."""
        nothing = np.zeros((0, 2), dtype=np.int64)
        alone = _components(np.arange(keypoints), nothing)
        return cls(nothing, nothing, np.zeros(0, dtype=np.bool_), alone)

    def of_keypoints(self, keypoints: np.ndarray) -> tuple[Self, np.ndarray]:
        """Return the bones between some keypoints, sorted indices, and the indices of these bones.

        Args:
            keypoints: shape (keypoint,), whole groups of connected keypoints.
        """
        kept = np.flatnonzero(np.isin(self.ends[:, 0], keypoints))
        ends = np.ascontiguousarray(np.searchsorted(keypoints, self.ends[kept]), dtype=np.int64)
        order = self.order[np.isin(self.order[:, 0], kept)]
        order = np.stack([np.searchsorted(kept, order[:, 0]), order[:, 1]], axis=1)
        label = np.searchsorted(keypoints, _lowest_of_group(self.components)[keypoints])
        return type(self)(
            ends, order, self.rigid[kept], _components(np.unique(label, return_inverse=True)[1], ends)
        ), kept

    @property
    def batches(self) -> list[np.ndarray]:
        """Whole groups of keypoints that are solved together: sorted indices, in all every keypoint once.

        Small groups are joined, because each call of a kernel on few keypoints costs as much as the work in it.
        """
        found: list[np.ndarray] = []
        first = 0
        ends = self.components.ends[:, 0]
        for end in ends:
            if end - first >= _MIN_BATCH or end == ends[-1]:
                found.append(np.sort(self.components.keypoints[first:end]))
                first = end
        return found

    @classmethod
    def of(cls, skeleton: Skeleton) -> Self:
        """Return the unique edges of a skeleton."""
        if not len(skeleton.edge_indices):
            return cls.none(len(skeleton))
        ends = np.unique(np.sort(skeleton.edge_indices, axis=1), axis=0)
        n = len(skeleton)
        graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n, n)).tocsr()
        _, label = connected_components(graph, directed=False)
        number = {(int(a), int(b)): i for i, (a, b) in enumerate(ends)}
        order = []
        for root in np.unique(label, return_index=True)[1]:
            visited, parent = breadth_first_order(graph, int(root), directed=False)
            for outer in visited[1:]:
                inner = parent[outer]
                bone = number[min(int(inner), int(outer)), max(int(inner), int(outer))]
                order.append((bone, int(ends[bone, 0] != outer)))
        rigid_pairs = {frozenset((skeleton.index(a), skeleton.index(b))) for a, b in skeleton.rigid}
        rigid = np.array([frozenset((int(a), int(b))) in rigid_pairs for a, b in ends])
        ends = np.ascontiguousarray(ends, dtype=np.int64)
        return cls(ends, np.array(order, dtype=np.int64).reshape(-1, 2), rigid, _components(label, ends))


def _components(label: np.ndarray, ends: np.ndarray) -> Components:
    """Return the groups of keypoints with equal labels, shape (keypoint,), and of their bones."""
    bone_label = label[ends[:, 0]]
    groups = np.arange(label.max(initial=-1) + 1)
    counts = np.stack([np.bincount(each, minlength=len(groups)) for each in (label, bone_label)], axis=1)
    keypoints, bones = (np.argsort(each, kind="stable").astype(np.int64) for each in (label, bone_label))
    return Components(keypoints, bones, np.cumsum(counts, axis=0, dtype=np.int64))


def _lowest_of_group(components: Components) -> np.ndarray:
    """Return the lowest keypoint of the group of each keypoint, shape (keypoint,)."""
    lowest, first = np.empty(len(components.keypoints), dtype=np.int64), 0
    for end in components.ends[:, 0]:
        group = components.keypoints[first:end]
        lowest[group] = group.min()
        first = end
    return lowest
