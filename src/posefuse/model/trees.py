"""Kinematic trees: what of a body turns, what it carries, and how large it is.

A tree stands in a skeleton's TOML, under ``[tree]``, or in one of the files ``bodies/`` that several skeletons share
(``tree = "human"``); of those only what bears on the skeleton's keypoints is taken. It has the tables:

* ``segments``: name to ``{at = point}``; each turns freely about a point. The first is the root and has no ``at``; its
  origin is where the body is, and is a point of the segment's own name.
* ``points``: name to ``[segment, forward, left, up]``, metres, of an adult: what rides on a segment. A coordinate of
  exactly 0 stays 0, others differ from person to person. With a point in place of the segment it rides beside that
  point, in the axes of that point's segment, so far off on everybody.
* ``bones``: name of the point at the far end to ``[point at the near end, length]`` or ``[point, length, [forward,
  left, up]]`` with the direction when standing (by default down): sticks of which only the direction can be seen.
* ``hinges``: name of the far end of a bone to ``[segment, axis]``, the axis in the segment's axes: the bone before it,
  times it (a cross product), points along the axis.
* ``cones``: name of the far end of a bone to ``[segment, axis, most degrees]``: how far from the axis it swings.
* ``twists``: name of a segment to ``[segment, axis, most degrees]``: how far the axis turns from one to the other.
* ``spread``, ``size_spread``: how much lengths differ between people, as a share, each by itself and all together.
* ``size_m``: how large the body is, by default 1.75: lengths in options are an adult human's, and are taken in
  proportion.
* ``least_sd_m``: how much any coordinate of a point differs between people at least, by default 0.015 of an adult.
* ``parts``: files of ``bodies/`` with what is followed for itself, given where the body has it, see
  :mod:`posefuse.model.parts`.

Points are keypoints of the skeleton or joints that no detector sees. What is said of a left side holds for the right
one, mirrored. A table of ``size_m`` alone makes the edges of the skeleton a tree of bones.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.resources import files
from typing import Any

import numpy as np

from posefuse.arrays import Rebuilt, frozen
from posefuse.errors import SkeletonError, choices, suggestion

_TABLES = ("segments", "points", "bones", "hinges", "cones", "twists")
_NUMBERS = ("spread", "size_spread", "size_m", "least_sd_m")
_ROWS = {
    "points": "[segment or point, forward, left, up]",
    "bones": "[point, length] or [point, length, [forward, left, up]]",
    "hinges": "[segment, [forward, left, up]]",
    "cones": "[segment, [forward, left, up], degrees]",
    "twists": "[segment, [forward, left, up], degrees]",
}
_MIRROR = np.array([1.0, -1.0, 1.0])
_SPREAD, _SIZE_SPREAD = 0.08, 0.07
_LEAST_SD = 0.015
"""Of a coordinate of a human's; of other bodies in proportion."""
ADULT_M = 1.75
"""The height of the human whose lengths are those in options."""
_EDGE_SHARE, _EDGE_SPREAD = 0.25, 0.5
"""Of a body of which only the size is known: how long a bone is as a share of it, and by which share that is off."""
_DOWN = (0.0, 0.0, -1.0)
_STAYS, _NOBODYS, _PLAIN = (0.0, 0.0, 0.0), (-1, -1, -1), (1.0, 1.0, 1.0)
HINGE = 0
CONE = 1
TWIST = 2


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


def parse_tree(table: Mapping[str, Any], keypoints: Sequence[str], partner: Mapping[str, str], skeleton: str) -> Tree:
    """A tree from its table in a skeleton's TOML.

    Args:
        table: ``[tree]``.
        keypoints: of the skeleton.
        partner: left name to right name.
        skeleton: its name, for messages.

    Raises:
        SkeletonError: where the table names what is not there.
    """
    _check_tables(table, skeleton)
    segments: Mapping[str, Any] = table["segments"]
    mirrored = {f"left_{name[5:]}" for name in segments if f"right_{name[5:]}" in segments and name.startswith("left_")}
    sides = {**partner, **{name: f"right_{name[5:]}" for name in mirrored}}
    points, bones = _bearing_on(keypoints, segments, table.get("points", {}), table.get("bones", {}), sides)
    used = {_segment_of(row, points) for row in points.values()}
    used |= {sides.get(name, name) for name in used}
    segments = {name: at for i, (name, at) in enumerate(segments.items()) if i == 0 or name in used}
    builder = _Builder(skeleton, sides)
    builder.add_segments(segments, points, bones)
    limits = (
        *builder.hinges(_of_what_is_there(table.get("hinges", {}), bones, segments)),
        *builder.cones(_of_what_is_there(table.get("cones", {}), bones, segments)),
        *builder.twists(_of_what_is_there(table.get("twists", {}), segments, segments)),
    )
    size_m = float(table.get("size_m", ADULT_M))
    spreads = float(table.get("spread", _SPREAD)), float(table.get("size_spread", _SIZE_SPREAD))
    least_sd_m = float(table.get("least_sd_m", _LEAST_SD * size_m / ADULT_M))
    return builder.finish(keypoints, limits, spreads, least_sd_m, size_m)


def _check_tables(table: Mapping[str, Any], skeleton: str) -> None:
    """Complain of what no tree can be made of."""
    where = f"Skeleton {skeleton!r}: tree"
    _check_names_and_numbers(table, where)
    _check_segments(table.get("segments", {}), where)
    segments, bones = table["segments"], table.get("bones", {})
    beside = {**segments, **{n: row for n, row in table.get("points", {}).items() if row and row[0] in segments}}
    for key in _ROWS:
        for name, row in table.get(key, {}).items():
            _check_row(key, name, row, segments, bones, beside, where)
    for name in table.get("points", {}):
        if name in bones or name == next(iter(segments)):
            raise SkeletonError(f"{where}: {name!r} stands twice; a point is the root, rides, or ends a bone.")


def _check_names_and_numbers(table: Mapping[str, Any], where: str) -> None:
    known = (*_TABLES, *_NUMBERS, "parts")
    for key in table:
        if key not in known:
            raise SkeletonError(f"{where} has no table {key!r}. {suggestion(key, known)}")
    for key in _NUMBERS:
        value = table.get(key, 1.0)
        if not _is_number(value) or not value > 0.0:
            raise SkeletonError(f"{where}.{key} is a positive number, got {value!r}.")


def _check_segments(segments: Mapping[str, Any], where: str) -> None:
    if not segments:
        raise SkeletonError(f"{where} has no segments; it needs one or more, and the first is the root.")
    for i, (name, row) in enumerate(segments.items()):
        if not isinstance(row, Mapping) or set(row) != (set() if i == 0 else {"at"}):
            wanted = "{}, it is the root" if i == 0 else '{ at = "the point that it turns about" }'
            raise SkeletonError(f"{where}.segments.{name} is {wanted}; got {row!r}.")
        if name.startswith("left_") and f"right_{name[5:]}" not in segments:
            raise SkeletonError(f"{where}.segments has {name!r} but no 'right_{name[5:]}': name both.")


def _check_row(
    table: str,
    name: str,
    row: Any,
    segments: Mapping[str, Any],
    bones: Mapping[str, Any],
    beside: Mapping[str, Any],
    where: str,
) -> None:
    if not _is_row(table, row):
        raise SkeletonError(f"{where}.{table}.{name} is {_ROWS[table]}, lengths above 0; got {row!r}.")
    known = segments if table == "twists" else bones
    if table in ("hinges", "cones", "twists") and name not in known:
        raise SkeletonError(f"{where}.{table} names {name!r}, which is no such end. {suggestion(name, known)}")
    if table != "bones" and row[0] not in (segments if table != "points" else beside):
        raise SkeletonError(f"{where}.{table}.{name}: no segment {row[0]!r}. {suggestion(row[0], segments)}")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_row(table: str, row: object) -> bool:
    """Whether a row of a table is one such as ``_ROWS`` says."""
    if not isinstance(row, list) or not row or not isinstance(row[0], str):
        return False
    numbers = [_is_number(x) for x in row[1:]]
    axes = [isinstance(x, list) and len(x) == 3 and all(map(_is_number, x)) and any(x) for x in row[1:]]
    if table == "points":
        return numbers == [True] * 3
    if table == "bones":
        return numbers[:1] == [True] and row[1] > 0.0 and axes[1:] in ([], [True])
    return axes[:1] == [True] and numbers[1:] == ([] if table == "hinges" else [True])


def _of_what_is_there(table: Mapping[str, Any], ends: Mapping[str, Any], segments: Mapping[str, Any]) -> dict[str, Any]:
    """The limits of bones and segments that the skeleton's keypoints bear on."""
    return {name: row for name, row in table.items() if name in ends and row[0] in segments}


def _segment_of(row: Sequence[Any], points: Mapping[str, Any]) -> str:
    """The segment that a point rides on, maybe beside another."""
    return str(points[row[0]][0]) if row[0] in points else str(row[0])


def _bearing_on(
    keypoints: Sequence[str],
    segments: Mapping[str, Any],
    points: Mapping[str, Any],
    bones: Mapping[str, Any],
    partner: Mapping[str, str],
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The points and bones that are keypoints, or that keypoints hang on."""
    hangs_on = {
        name: str(dict(segments[row[0]]).get("at", "")) if row[0] in segments else str(row[0])
        for name, row in points.items()
    }
    hangs_on.update({name: str(row[0]) for name, row in bones.items()})
    wanted: set[str] = set()
    for name in hangs_on:
        here = name if name in keypoints or partner.get(name) in keypoints else ""
        while here and here not in wanted:
            wanted.add(here)
            here = hangs_on.get(here, "")
    return {n: r for n, r in points.items() if n in wanted}, {n: r for n, r in bones.items() if n in wanted}


@cache
def shared_body(name: str) -> Mapping[str, Any]:
    """The tables of a body that several skeletons share.

    Raises:
        SkeletonError: if there is none of that name.
    """
    folder = files("posefuse.model").joinpath("bodies")
    known = sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))
    if name not in known:
        raise SkeletonError(f"No body {name!r} to take a tree from. {suggestion(name, known)}")
    return tomllib.loads(folder.joinpath(f"{name}.toml").read_text("utf-8"))


class _Builder:
    """Puts nodes in order, left sides before their mirror images."""

    def __init__(self, skeleton: str, partner: dict[str, str]) -> None:
        self.skeleton, self.partner = skeleton, partner
        self.segments: list[str] = []
        self.bones: list[str] = []
        self.nodes: list[Node] = []
        self.shape_names: list[str] = []
        self.shape_m: list[float] = []
        self.place_of: dict[str, int] = {}
        self.rest: list[np.ndarray] = []

    def add_segments(self, segments: Mapping[str, Any], points: Mapping[str, Any], bones: Mapping[str, Any]) -> None:
        """Everything, in an order in which what a thing hangs on comes before it."""
        names = list(segments)
        for name in names:
            self.segments.append(name)
        self._put(Node(names[0], -1, 0, False, (0.0, 0.0, 0.0), (-1, -1, -1), (1.0, 1.0, 1.0)))
        waiting = {**{p: ("point", row) for p, row in points.items()}, **{b: ("bone", row) for b, row in bones.items()}}
        at = {
            name: names[0] if i == 0 else str(dict(segments[name]).get("at", names[0])) for i, name in enumerate(names)
        }
        while waiting:
            ready = [
                n
                for n, (kind, row) in waiting.items()
                if (at.get(row[0], row[0]) if kind == "point" else row[0]) in self.place_of
            ]
            if not ready:
                raise SkeletonError(
                    f"Skeleton {self.skeleton!r}: points {choices(waiting)} of the tree hang on what is not there. "
                    f"There are segments {choices(names)} and points {choices(self.place_of)}."
                )
            for name in ready:
                kind, row = waiting.pop(name)
                if kind == "point":
                    self._add_point(name, at.get(str(row[0]), str(row[0])), row)
                else:
                    self._add_bone(name, row)

    def _put(self, node: Node) -> None:
        self.place_of[node.name] = len(self.nodes)
        self.nodes.append(node)

    def _number(self, name: str, value: float) -> int:
        self.shape_names.append(name)
        self.shape_m.append(value)
        return len(self.shape_m) - 1

    def _own(self, name: str, axis: str, value: float) -> int:
        """The number of a person's own coordinate, -1 for one that stays 0."""
        return self._number(f"{name}.{axis}", value) if value != 0.0 else -1

    def _add_point(self, name: str, at: str, row: Sequence[Any]) -> None:
        forward, left, up = (float(x) for x in row[1:4])
        shape = _NOBODYS
        if row[0] in self.segments:
            shape = (self._own(name, "forward", forward), self._own(name, "left", left), self._own(name, "up", up))
        self._put(Node(name, self.place_of[at], self._mover(row[0]), False, (forward, left, up), shape, _PLAIN))
        other = self.partner.get(name)
        if other is not None:
            parent = self.place_of[self.partner.get(at, at)]
            mover = self._mover(self.partner.get(str(row[0]), str(row[0])))
            self._put(Node(other, parent, mover, False, (forward, -left, up), shape, (1.0, -1.0, 1.0)))

    def _mover(self, name: str) -> int:
        """The number of a segment, or of that of a point."""
        return self.segments.index(name) if name in self.segments else self.nodes[self.place_of[name]].mover

    def _add_bone(self, name: str, row: Sequence[Any]) -> None:
        length = float(row[1])
        number = self._number(name, length)
        start = str(row[0])
        ends = [(name, start)]
        if name in self.partner:
            ends.append((self.partner[name], self.partner.get(start, start)))
        for end, near in ends:
            self.bones.append(end)
            direction = np.array(row[2] if len(row) > 2 else _DOWN, dtype=float)
            self.rest.append(np.array(_unit(direction * (np.ones(3) if end == name else _MIRROR))))
            self._put(
                Node(
                    end,
                    self.place_of[near],
                    len(self.bones) - 1,
                    True,
                    (0.0, 0.0, length),
                    (-1, -1, number),
                    (1.0, 1.0, 1.0),
                )
            )

    def hinges(self, table: Mapping[str, Any]) -> list[Limit]:
        """Of both sides. A mirror turns the sense of a cross product round: only its part across keeps its sign."""
        found = []
        for name, (segment, axis) in table.items():
            for end, mirror in ((name, np.ones(3)), (self.partner.get(name), -_MIRROR)):
                if end is not None:
                    before = self._bone(self.nodes[self.nodes[self.place_of[end]].parent].name)
                    turned = _unit(np.array(axis, dtype=float) * mirror)
                    found.append(Limit(HINGE, self._bone(end), before, self._segment(segment), turned, -0.1))
        return found

    def cones(self, table: Mapping[str, Any]) -> list[Limit]:
        """Of both sides."""
        found = []
        for name, (segment, axis, degrees) in table.items():
            for end, mirror in ((name, np.ones(3)), (self.partner.get(name), _MIRROR)):
                if end is not None:
                    turned = _unit(np.array(axis, dtype=float) * mirror)
                    least = float(np.cos(np.radians(degrees)))
                    found.append(Limit(CONE, self._bone(end), -1, self._segment(segment), turned, least))
        return found

    def twists(self, table: Mapping[str, Any]) -> list[Limit]:
        """Between segments."""
        return [
            Limit(
                TWIST,
                self._segment(name),
                -1,
                self._segment(other),
                _unit(np.array(axis, dtype=float)),
                float(np.cos(np.radians(degrees))),
            )
            for name, (other, axis, degrees) in table.items()
        ]

    def _bone(self, end: str) -> int:
        if end not in self.bones:
            raise SkeletonError(f"Skeleton {self.skeleton!r}: no bone ends in {end!r}. {suggestion(end, self.bones)}")
        return self.bones.index(end)

    def _segment(self, name: str) -> int:
        if name not in self.segments:
            raise SkeletonError(f"Skeleton {self.skeleton!r}: no segment {name!r}. {suggestion(name, self.segments)}")
        return self.segments.index(name)

    def finish(
        self,
        keypoints: Sequence[str],
        limits: tuple[Limit, ...],
        spreads: tuple[float, float],
        least_sd_m: float,
        size_m: float,
    ) -> Tree:
        """The tree, and how shapes differ between people."""
        shape, (spread, size_spread) = np.array(self.shape_m), spreads
        own = np.maximum(spread * np.abs(shape), least_sd_m)
        covariance = np.diag(own**2) + size_spread**2 * np.outer(shape, shape)
        return Tree(
            tuple(self.segments),
            tuple(self.bones),
            tuple(self.nodes),
            limits,
            tuple(self.shape_names),
            frozen(shape),
            frozen(covariance),
            frozen(np.array([self.place_of.get(name, -1) for name in keypoints]), np.int64),
            frozen(np.array(self.rest).reshape(-1, 3)),
            size_m,
        )


def sided(tree: Tree, side: str) -> Tree:
    """A tree of a left side with names of that side; mirrored, where that is ``right``.

    Args:
        tree: with names that say nothing of a side.
        side: ``left`` or ``right``.
    """
    mirror = _MIRROR if side == "right" else np.ones(3)
    # A mirror turns the sense of a cross product round, but for its part across.
    of_hinge = -_MIRROR if side == "right" else np.ones(3)
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


def _unit(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (vector / np.linalg.norm(vector)).tolist()
    return x, y, z


def spanning_tree(
    keypoints: Sequence[str], edges: np.ndarray, lengths_m: np.ndarray, spread: float, size_m: float, mirror: np.ndarray
) -> Tree:
    """The bones that edges are, for skeletons that say nothing of how they turn.

    The keypoint of most edges is the root. Keypoints that no edges connect with it have no node, and an edge that
    closes a ring is no bone. Bones that mirror each other are of one length.

    Args:
        keypoints: names.
        edges: shape (edge, 2), int.
        lengths_m: shape (edge,): of the bones.
        spread: by which share lengths are off, each by itself and all together.
        size_m: of the body.
        mirror: shape (keypoint,), int: each keypoint's partner on the other side, else itself.
    """
    neighbours: list[list[tuple[int, float]]] = [[] for _ in keypoints]
    for (a, b), length in zip(edges.tolist(), lengths_m.tolist(), strict=True):
        neighbours[a].append((b, length))
        neighbours[b].append((a, length))
    root = int(np.argmax([len(of) for of in neighbours]))
    nodes = [Node(keypoints[root], -1, 0, False, _STAYS, _NOBODYS, _PLAIN)]
    place_of, number_of = {root: 0}, dict[frozenset[int], int]()
    bones: list[str] = []
    names: list[str] = []
    shape: list[float] = []
    order = [root]
    for here in order:
        for other, length in neighbours[here]:
            if other in place_of:
                continue
            place_of[other] = len(nodes)
            number = number_of.get(frozenset((int(mirror[here]), int(mirror[other]))), len(shape))
            if number == len(shape):
                shape.append(length)
                names.append(keypoints[other])
            number_of[frozenset((here, other))] = number
            place = (0.0, 0.0, shape[number])
            nodes.append(Node(keypoints[other], place_of[here], len(bones), True, place, (-1, -1, number), _PLAIN))
            bones.append(keypoints[other])
            order.append(other)
    values = np.array(shape)
    return Tree(
        segments=(),
        bones=tuple(bones),
        nodes=tuple(nodes),
        limits=(),
        shape_names=tuple(names),
        shape_m=frozen(values),
        shape_covariance=frozen(spread**2 * (np.diag(values**2) + np.outer(values, values))),
        keypoint_nodes=frozen(np.array([place_of.get(k, -1) for k in range(len(keypoints))]), np.int64),
        rest=frozen(np.tile(_DOWN, (len(bones), 1))),
        size_m=size_m,
    )


def tree_of_size(keypoints: Sequence[str], edges: np.ndarray, size_m: float, mirror: np.ndarray) -> Tree:
    """The bones that edges are, of a body of which only the size is known: any of them may be half as long, or twice.

    Args:
        keypoints: names.
        edges: shape (edge, 2), int.
        size_m: from end to end.
        mirror: shape (keypoint,), int: each keypoint's partner on the other side, else itself.
    """
    return spanning_tree(keypoints, edges, np.full(len(edges), _EDGE_SHARE * size_m), _EDGE_SPREAD, size_m, mirror)
