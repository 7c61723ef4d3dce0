"""Assembly of a kinematic tree, node by node."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from posefuse.arrays import frozen
from posefuse.errors import SkeletonError, choices, suggestion
from posefuse.skeleton.trees import CONE, CONSTANT, DOWN, HINGE, MIRROR, TWIST, UNREFLECTED, Limit, Node, Tree


class TreeBuilder:
    """Collect the nodes of a tree, parents first, left sides before their reflections."""

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
        """Add all segments, points and bones, parents before children."""
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
                    f"Skeleton {self.skeleton!r}: points {choices(waiting)} of the tree have unknown parents. "
                    f"Known segments: {choices(names)}; known points: {choices(self.place_of)}."
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
        """Return the shape index of a person-specific coordinate, -1 for a constant 0."""
        return self._number(f"{name}.{axis}", value) if value != 0.0 else -1

    def _add_point(self, name: str, at: str, row: Sequence[Any]) -> None:
        forward, left, up = (float(x) for x in row[1:4])
        shape = CONSTANT
        if row[0] in self.segments:
            shape = (self._own(name, "forward", forward), self._own(name, "left", left), self._own(name, "up", up))
        self._put(Node(name, self.place_of[at], self._mover(row[0]), False, (forward, left, up), shape, UNREFLECTED))
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
            direction = np.array(row[2] if len(row) > 2 else DOWN, dtype=float)
            self.rest.append(np.array(_unit(direction * (np.ones(3) if end == name else MIRROR))))
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
        """Return the hinges of both sides. A reflection reverses a cross product, except its lateral component."""
        found = []
        for name, (segment, axis) in table.items():
            for end, mirror in ((name, np.ones(3)), (self.partner.get(name), -MIRROR)):
                if end is not None:
                    before = self._bone(self.nodes[self.nodes[self.place_of[end]].parent].name)
                    turned = _unit(np.array(axis, dtype=float) * mirror)
                    found.append(Limit(HINGE, self._bone(end), before, self._segment(segment), turned, -0.1))
        return found

    def cones(self, table: Mapping[str, Any]) -> list[Limit]:
        """Return the cones of both sides."""
        found = []
        for name, (segment, axis, degrees) in table.items():
            for end, mirror in ((name, np.ones(3)), (self.partner.get(name), MIRROR)):
                if end is not None:
                    turned = _unit(np.array(axis, dtype=float) * mirror)
                    least = float(np.cos(np.radians(degrees)))
                    found.append(Limit(CONE, self._bone(end), -1, self._segment(segment), turned, least))
        return found

    def twists(self, rows: Sequence[tuple[str, Any]]) -> list[Limit]:
        """Return the twist limits between segments from their rows, each with the name of a segment."""
        return [
            Limit(
                TWIST,
                self._segment(name),
                -1,
                self._segment(other),
                _unit(np.array(axis, dtype=float)),
                float(np.cos(np.radians(degrees))),
            )
            for name, (other, axis, degrees) in rows
        ]

    def _bone(self, end: str) -> int:
        if end not in self.bones:
            raise SkeletonError(
                f"Skeleton {self.skeleton!r}: there is no bone that ends at {end!r}. {suggestion(end, self.bones)}"
            )
        return self.bones.index(end)

    def _segment(self, name: str) -> int:
        if name not in self.segments:
            raise SkeletonError(
                f"Skeleton {self.skeleton!r}: unknown segment {name!r}. {suggestion(name, self.segments)}"
            )
        return self.segments.index(name)

    def finish(
        self,
        keypoints: Sequence[str],
        limits: tuple[Limit, ...],
        spreads: tuple[float, float],
        least_sd_m: float,
        size_m: float,
    ) -> Tree:
        """Return the tree with the variation of its lengths between people."""
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


def _unit(vector: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (vector / np.linalg.norm(vector)).tolist()
    return x, y, z
