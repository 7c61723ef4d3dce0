"""Kinematic trees: what of a body turns, what it carries, and how large it is.

Trees come from a skeleton's TOML (:mod:`posefuse.skeleton.tree_tables`) or from its edges
(:mod:`posefuse.skeleton.trees_from_edges`).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posefuse.arrays import Rebuilt, frozen

ADULT_M = 1.75
"""The height of the human whose lengths are those in options."""
HINGE = 0
CONE = 1
TWIST = 2
MIRROR = frozen([1.0, -1.0, 1.0])
"""From a left side to the right one, in the axes forward, left, up."""
DOWN = (0.0, 0.0, -1.0)
"""Where a bone hangs when nothing else is said."""
NOBODYS, PLAIN = (-1, -1, -1), (1.0, 1.0, 1.0)
"""Of a node: coordinates that are no number of the person's shape, and that are mirror images of none."""


@dataclass(frozen=True)
class Node:
    """A point of a tree.

    Attributes:
        name: of the point.
        parent: number of the node it hangs on, -1 for the root.
        mover: the segment or bone that moves it, by number.
        is_bone: whether that is a bone.
        place_m: shape (3,): where it is in the segment's axes; a bone's length is its last number.
        shape: which number of the person's shape each coordinate is, -1 where it stays.
        sign: -1 where it is the mirror image of that number.
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
    """How far a joint goes.

    Attributes:
        kind: HINGE, CONE or TWIST.
        bone: its number; of a twist, that of the segment.
        before: the bone before it, of a hinge; else -1.
        segment: in whose axes the axis is; of a twist, in whose too.
        axis: unit vector.
        least: of the cosine (cone, twist) or the sine (hinge).
    """

    kind: int
    bone: int
    before: int
    segment: int
    axis: tuple[float, float, float]
    least: float


@dataclass(frozen=True, eq=False)
class Tree(Rebuilt):
    """A kinematic tree with the shape of a body.

    The pose has 3 numbers for where the root is, 3 for each segment's turn, 2 for each bone's direction, in this order;
    after them comes the shape: lengths in metres that are a person's own.

    Attributes:
        segments: names.
        bones: names of their far ends.
        nodes: points, parents before children; the first is the root.
        limits: of joints.
        shape_names: what each number of the shape is.
        shape_m: shape (shape,): of an adult.
        shape_covariance: shape (shape, shape): between people, m^2.
        keypoint_nodes: shape (keypoint,), int64: the node of each keypoint of the skeleton, -1 where it has none.
        rest: shape (bone, 3): directions when standing, in the axes of the root.
        size_m: how large the body is.
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

    @property
    def scale(self) -> float:
        """How large the body is next to an adult human."""
        return self.size_m / ADULT_M

    @property
    def n_pose(self) -> int:
        """How many numbers a pose has, and a velocity."""
        return 3 + 3 * len(self.segments) + 2 * len(self.bones)

    @property
    def n_shape(self) -> int:
        """How many numbers a shape has."""
        return len(self.shape_m)

    @cached_property
    def packed(self) -> tuple[np.ndarray, ...]:
        """For kernels: parents, movers, is_bone, places, shape, sign, starts of columns, columns."""
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
        """For kernels: shape (limit, 4), int64: kind, bone, before, segment; and (limit, 4): axis, least."""
        whole = [(limit.kind, limit.bone, limit.before, limit.segment) for limit in self.limits]
        real = [(*limit.axis, limit.least) for limit in self.limits]
        return frozen(np.array(whole).reshape(-1, 4), np.int64), frozen(np.array(real).reshape(-1, 4))

    def node(self, name: str) -> int:
        """The number of a point, by name."""
        return [node.name for node in self.nodes].index(name)


def _columns(tree: Tree) -> tuple[np.ndarray, np.ndarray]:
    """Which numbers of pose and shape move each node: starts (node + 1,) into the columns, ascending."""
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
    """A tree of a left side with names of that side; mirrored, where that is ``right``.

    Args:
        tree: with names that say nothing of a side.
        side: ``left`` or ``right``.
    """
    mirror = MIRROR if side == "right" else np.ones(3)
    # A mirror turns the sense of a cross product round, but for its part across.
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
