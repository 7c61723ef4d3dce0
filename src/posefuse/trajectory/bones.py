"""Bones of the trajectory solve: edges of the skeleton, and the forest along which information propagates."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from posefuse.kernels.trajectory.band import LANES
from posefuse.kernels.trajectory.bone_solve import Groups
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
        groups: groups of keypoints that the bones connect, and one of the keypoints without bones.
    """

    ends: np.ndarray
    order: np.ndarray
    rigid: np.ndarray
    groups: Groups

    def of_keypoints(self, keypoints: np.ndarray) -> tuple[Self, np.ndarray]:
        """Return the bones between some keypoints, sorted indices, and the indices of these bones.

        Args:
            keypoints: shape (keypoint,), whole groups of connected keypoints.
        """
        kept = np.flatnonzero(np.isin(self.ends[:, 0], keypoints))
        ends = np.ascontiguousarray(np.searchsorted(keypoints, self.ends[kept]), dtype=np.int64)
        order = self.order[np.isin(self.order[:, 0], kept)]
        order = np.stack([np.searchsorted(kept, order[:, 0]), order[:, 1]], axis=1)
        label = np.empty(len(keypoints), dtype=np.int64)
        for number, own in enumerate(self._keypoints_of_groups):
            label[np.isin(keypoints, own)] = number
        return type(self)(ends, order, self.rigid[kept], _groups(label, ends)), kept

    @property
    def batches(self) -> list[np.ndarray]:
        """Whole groups of keypoints that are solved together: sorted indices, in all every keypoint once.

        Small groups are joined, because each call of a kernel on few keypoints costs as much as the work in it.
        """
        found: list[np.ndarray] = []
        batch: list[np.ndarray] = []
        for keypoints in self._keypoints_of_groups:
            batch.append(keypoints)
            if sum(len(each) for each in batch) >= _MIN_BATCH:
                found.append(np.sort(np.concatenate(batch)))
                batch = []
        return [*found, np.sort(np.concatenate(batch))] if batch else found

    @property
    def _keypoints_of_groups(self) -> list[np.ndarray]:
        """The keypoints of each group."""
        tiles = np.split(self.groups.tiles, self.groups.ends[:-1, 0])
        return [each[each >= 0] for each in tiles]

    @classmethod
    def none(cls, keypoints: int) -> Self:
        """Return a record without bones."""
        nothing = np.zeros((0, 2), dtype=np.int64)
        alone = _groups(np.arange(keypoints), nothing)
        return cls(nothing, nothing, np.zeros(0, dtype=np.bool_), alone)

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
        return cls(ends, np.array(order, dtype=np.int64).reshape(-1, 2), rigid, _groups(label, ends))


def _groups(label: np.ndarray, ends: np.ndarray) -> Groups:
    """Return the groups of keypoints with equal labels, shape (keypoint,), and of their bones."""
    bone_label = label[ends[:, 0]]
    with_bones = np.unique(bone_label)
    tiles, bones = [np.zeros((0, LANES), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    sizes = []
    for one in (*with_bones, None):
        keypoints = np.flatnonzero(~np.isin(label, with_bones) if one is None else label == one)
        own_bones = np.flatnonzero(bone_label == one) if one is not None else np.zeros(0, dtype=np.int64)
        if not len(keypoints):
            continue
        padded = np.full(-(-len(keypoints) // LANES) * LANES, -1)
        padded[: len(keypoints)] = keypoints
        tiles.append(padded.reshape(-1, LANES))
        bones.append(own_bones)
        sizes.append((len(tiles[-1]), len(own_bones)))
    counts = np.array(sizes, dtype=np.int64).reshape(-1, 2)
    return Groups(np.concatenate(tiles), np.concatenate(bones), np.cumsum(counts, axis=0))
