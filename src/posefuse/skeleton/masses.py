"""Where a body's mass is: tables of segments, one TOML file each in the folder ``mass_tables`` beside this module."""

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from posefuse.errors import SkeletonError
from posefuse.skeleton.skeletons import Skeleton

Ends = tuple[tuple[str, ...], tuple[str, ...], float]
"""Keypoints of the near end, those of the far end, and where from near to far the centre lies."""


@dataclass(frozen=True)
class MassSegment:
    """A part of the body and its mass.

    Attributes:
        name: of the segment.
        mass: as a share of the body's.
        ends: the ways to find it, best first.
    """

    name: str
    mass: float
    ends: tuple[Ends, ...]

    def ends_in(self, skeleton: Skeleton) -> Ends | None:
        """The best way for which the skeleton has the keypoints."""
        there = set(skeleton.keypoints)
        return next((row for row in self.ends if there.issuperset((*row[0], *row[1]))), None)


@dataclass(frozen=True)
class Masses:
    """A table of segments.

    Attributes:
        name: of the table.
        source: where its numbers are from.
        segments: of which all masses together are the body's.
    """

    name: str
    source: str
    segments: tuple[MassSegment, ...]

    def check(self, skeleton: Skeleton) -> None:
        """Refuse a skeleton that lacks a segment.

        Raises:
            SkeletonError: naming the first segment it lacks.
        """
        for segment in self.segments:
            if segment.ends_in(skeleton) is None:
                near, far, _ = segment.ends[0]
                raise SkeletonError(
                    f"The centre of mass by {self.name} needs the segment {segment.name} ({', '.join(near)} to "
                    f"{', '.join(far)}), and skeleton {skeleton.name} lacks keypoints of it. Leave "
                    "subject.mass_table out."
                )


@cache
def mass_table(name: str) -> Masses:
    """A table that comes with posefuse, by name; segments of one side are there for both."""
    text = files("posefuse.skeleton").joinpath("mass_tables", f"{name}.toml").read_text("utf-8")
    data = tomllib.loads(text)
    segments = []
    for row in data["segment"]:
        ends = tuple((tuple(near), tuple(far), float(centre)) for near, far, centre in row["ends"])
        segments.append(MassSegment(row["name"], float(row["mass"]), ends))
        if row["name"].startswith("left_"):
            segments.append(MassSegment(_right(row["name"]), float(row["mass"]), tuple(map(_mirrored, ends))))
    return Masses(data["name"], data["source"], tuple(segments))


def _mirrored(ends: Ends) -> Ends:
    near, far, centre = ends
    return tuple(map(_right, near)), tuple(map(_right, far)), centre


def _right(name: str) -> str:
    return f"right_{name[5:]}" if name.startswith("left_") else name
