"""Kinematic trees: the segments, bones and lengths of a body model.

Trees come from a skeleton's TOML (:mod:`posefuse.skeleton.tree_tables`) or from its edges
(:mod:`posefuse.skeleton.trees_from_edges`).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posefuse.arrays import PickledByFields, frozen

ADULT_M = 1.75
"""Stature of the human to which lengths in options refer, in meters."""
HINGE = 0
CONE = 1
TWIST = 2
MIRROR = frozen([1.0, -1.0, 1.0])
"""Reflection from the left side to the right one, in the axes forward, left, up."""
DOWN = (0.0, 0.0, -1.0)
"""Default rest direction of a bone."""
CONSTANT, UNREFLECTED = (-1, -1, -1), (1.0, 1.0, 1.0)
"""Shape indices of a node with constant coordinates, and signs of a node without reflection."""


@dataclass(frozen=True)
class Node:
    """A point of a tree.

    Attributes:
        name: name of the point.
        parent: index of the parent node, -1 for the root.
        mover: index of the segment or bone that moves it.
        is_bone: whether the mover is a bone.
        place_m: shape (3,): position in the segment's axes, in meters; the last number is the length of a bone.
        shape: index of the shape parameter of each coordinate, -1 if it is constant.
        sign: -1 where the coordinate is the reflection of the shape parameter.
    """

    name: str
    parent: int
    mover: int
    is_bone: bool
    place_m: tuple[float, float, float]
    shape: tuple[int, int, int]
    sign: tuple[float, float, float]


@dataclass(frozen=True)
class Limit:
    """The limit of a joint.

    Attributes:
        kind: HINGE, CONE or TWIST.
        bone: index of the bone; for a twist, of the segment.
        before: index of the previous bone of a hinge; otherwise -1.
        segment: index of the segment that defines the axes; for a twist, of the other segment.
        axis: unit vector.
        least: lower limit of the cosine (cone, twist) or sine (hinge).
    """

    kind: int
    bone: int
    before: int
    segment: int
    axis: tuple[float, float, float]
    least: float


@dataclass(frozen=True, eq=False)
class Tree(PickledByFields):
    """A kinematic tree with body lengths.

    A pose has 3 numbers for the root position, 3 per segment for its rotation, and 2 per bone for its direction, in
    this order. The shape follows: person-specific lengths in meters.

    Attributes:
        segments: names of the segments.
        bones: names of the distal ends of the bones.
        nodes: points, parents before children; the first is the root.
        limits: joint limits.
        shape_names: names of the shape parameters.
        shape_m: shape (shape,): mean lengths.
        shape_covariance: shape (shape, shape): covariance between people, m^2.
        keypoint_nodes: shape (keypoint,), int64: node of each keypoint of the skeleton, -1 without one.
        rest: shape (bone, 3): rest directions, in the axes of the root.
        size_m: body size in meters.
        offset_factor: distance between keypoints and the joints of the body, relative to a human of the same size.
    """

    segments: tuple[str, ...]
    bones: tuple[str, ...]
    nodes: tuple[Node, ...]
    limits: tuple[Limit, ...]
    shape_names: tuple[str, ...]
    shape_m: np.ndarray
    shape_covariance: np.ndarray
    keypoint_nodes: np.ndarray
    rest: np.ndarray
    size_m: float = ADULT_M
    offset_factor: float = 1.0

    @property
    def scale(self) -> float:
        """Ratio of the body size to that of an adult human."""
        return self.size_m / ADULT_M

    @property
    def n_pose(self) -> int:
        """Number of pose parameters, and of velocities."""
        return 3 + 3 * len(self.segments) + 2 * len(self.bones)

    @property
    def n_shape(self) -> int:
        """Number of shape parameters."""
        return len(self.shape_m)

    @cached_property
    def packed(self) -> tuple[np.ndarray, ...]:
        """Arrays for kernels: parents, movers, is_bone, places, shape, sign, starts of columns, columns."""
        nodes = self.nodes
        starts, columns = _columns(self)
        return (
            frozen(np.array([n.parent for n in nodes]), np.int64),
            frozen(np.array([n.mover for n in nodes]), np.int64),
            frozen(np.array([n.is_bone for n in nodes]), np.int64),
            frozen(np.array([n.place_m for n in nodes])),
            frozen(np.array([n.shape for n in nodes]), np.int64),
            frozen(np.array([n.sign for n in nodes])),
            frozen(starts, np.int64),
            frozen(columns, np.int64),
        )

    @cached_property
    def packed_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Arrays for kernels: shape (limit, 4), int64: kind, bone, before, segment; and (limit, 4): axis, least."""
        whole = [(limit.kind, limit.bone, limit.before, limit.segment) for limit in self.limits]
        real = [(*limit.axis, limit.least) for limit in self.limits]
        return frozen(np.array(whole).reshape(-1, 4), np.int64), frozen(np.array(real).reshape(-1, 4))

    def node(self, name: str) -> int:
        """Return the index of a node by name."""
        return [node.name for node in self.nodes].index(name)


def _columns(tree: Tree) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose and shape parameters that move each node: starts, shape (node + 1,), into ascending columns."""
    n_segments = len(tree.segments)
    found: list[list[int]] = []
    for node in tree.nodes:
        mine = set(found[node.parent]) if node.parent >= 0 else {0, 1, 2}
        if node.parent >= 0:
            first = 3 + (3 * n_segments + 2 * node.mover if node.is_bone else 3 * node.mover)
            mine.update(range(first, first + (2 if node.is_bone else 3)))
            mine.update(tree.n_pose + s for s in node.shape if s >= 0)
        found.append(sorted(mine))
    return np.cumsum([0, *(len(each) for each in found)]), np.array([c for each in found for c in each])


def sided(tree: Tree, side: str) -> Tree:
    """Return a tree for one side: names get the side as prefix, and the right side is reflected.

    Args:
        tree: tree of a left side, with names without side.
        side: ``left`` or ``right``.
    """
    mirror = MIRROR if side == "right" else np.ones(3)
    # A reflection reverses a cross product, except its lateral component.
    of_hinge = -MIRROR if side == "right" else np.ones(3)
    nodes = tuple(
        replace(
            node,
            name=f"{side}_{node.name}",
            place_m=node.place_m if node.is_bone else tuple((mirror * node.place_m).tolist()),
            sign=node.sign if node.is_bone else tuple((mirror * node.sign).tolist()),
        )
        for node in tree.nodes
    )
    limits = tuple(
        replace(limit, axis=tuple(((of_hinge if limit.kind == HINGE else mirror) * limit.axis).tolist()))
        for limit in tree.limits
    )
    return replace(
        tree,
        segments=tuple(f"{side}_{name}" for name in tree.segments),
        bones=tuple(f"{side}_{name}" for name in tree.bones),
        nodes=nodes,
        limits=limits,
        shape_names=tuple(f"{side}_{name}" for name in tree.shape_names),
        rest=frozen(mirror * tree.rest),
    )
