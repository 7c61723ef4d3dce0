"""Segment masses: tables in the folder ``mass_tables`` beside this module, one TOML file each."""

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from posefuse.errors import SkeletonError
from posefuse.skeleton.skeletons import Skeleton

Ends = tuple[tuple[str, ...], tuple[str, ...], float]
"""Keypoints of the proximal end, of the distal end, and the relative position of the center between them."""


@dataclass(frozen=True)
class MassSegment:
    """A segment of the body and its mass.

    Attributes:
        name: name of the segment.
        mass: fraction of the body mass.
        ends: alternative definitions of its ends, best first.
    """

    name: str
    mass: float
    ends: tuple[Ends, ...]

    def ends_in(self, skeleton: Skeleton) -> Ends | None:
        """Return the best definition for which the skeleton has the keypoints, or None."""
        there = set(skeleton.keypoints)
        return next((row for row in self.ends if there.issuperset((*row[0], *row[1]))), None)


@dataclass(frozen=True)
class Masses:
    """A table of segments.

    Attributes:
        name: name of the table.
        source: publication.
        segments: segments, whose masses sum to 1.
    """

    name: str
    source: str
    segments: tuple[MassSegment, ...]

    def fits(self, skeleton: Skeleton) -> bool:
        """Return whether a skeleton has all segments."""
        return all(segment.ends_in(skeleton) is not None for segment in self.segments)

    def check(self, skeleton: Skeleton) -> None:
        """Check that a skeleton has all segments.

        Raises:
            SkeletonError: if a segment is missing; the message names the first one.
        """
        for segment in self.segments:
            if segment.ends_in(skeleton) is None:
                near, far, _ = segment.ends[0]
                raise SkeletonError(
                    f"The center of mass with {self.name} needs the segment {segment.name} ({', '.join(near)} to "
                    f"{', '.join(far)}), but skeleton {skeleton.name} lacks its keypoints. Use a "
                    "skeleton that has them, or set subject.mass_table to none."
                )


def default_table(sex: str | None) -> Masses:
    """Return de Leva's table for the sex F or M, and the mean of both tables for any other."""
    return mass_table({"F": "de_leva_female", "M": "de_leva_male"}.get(sex or "", "de_leva_mean"))


@cache
def mass_table(name: str) -> Masses:
    """Return a shipped mass table by name, with segments of both sides; ``de_leva_mean`` is the mean of both sexes."""
    if name == "de_leva_mean":
        return _mean(name, mass_table("de_leva_female"), mass_table("de_leva_male"))
    text = files("posefuse.skeleton").joinpath("mass_tables", f"{name}.toml").read_text("utf-8")
    data = tomllib.loads(text)
    segments = []
    for row in data["segment"]:
        ends = tuple((tuple(near), tuple(far), float(center)) for near, far, center in row["ends"])
        segments.append(MassSegment(row["name"], float(row["mass"]), ends))
        if row["name"].startswith("left_"):
            segments.append(MassSegment(_right(row["name"]), float(row["mass"]), tuple(map(_mirrored, ends))))
    return Masses(data["name"], data["source"], tuple(segments))


def _mean(name: str, first: Masses, second: Masses) -> Masses:
    """Return the mean of two tables with the same segments and keypoints."""
    segments = tuple(
        MassSegment(
            a.name,
            0.5 * (a.mass + b.mass),
            tuple((*one[:2], 0.5 * (one[2] + two[2])) for one, two in zip(a.ends, b.ends, strict=True)),
        )
        for a, b in zip(first.segments, second.segments, strict=True)
    )
    return Masses(name, first.source.replace("females", "mean of females and males"), segments)


def _mirrored(ends: Ends) -> Ends:
    near, far, center = ends
    return tuple(map(_right, near)), tuple(map(_right, far)), center


def _right(name: str) -> str:
    return f"right_{name[5:]}" if name.startswith("left_") else name
