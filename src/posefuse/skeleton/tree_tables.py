"""The tables a kinematic tree is read from.

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
  :mod:`posefuse.skeleton.parts`.

Points are keypoints of the skeleton or joints that no detector sees. What is said of a left side holds for the right
one, mirrored. A table of ``size_m`` alone makes the edges of the skeleton a tree of bones.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from posefuse.errors import SkeletonError, suggestion
from posefuse.skeleton.tree_builder import TreeBuilder
from posefuse.skeleton.trees import ADULT_M, Tree

_TABLES = ("segments", "points", "bones", "hinges", "cones", "twists")
_NUMBERS = ("spread", "size_spread", "size_m", "least_sd_m")
_ROWS = {
    "points": "[segment or point, forward, left, up]",
    "bones": "[point, length] or [point, length, [forward, left, up]]",
    "hinges": "[segment, [forward, left, up]]",
    "cones": "[segment, [forward, left, up], degrees]",
    "twists": "[segment, [forward, left, up], degrees]",
}
_SPREAD, _SIZE_SPREAD = 0.08, 0.07
_LEAST_SD = 0.015
"""Of a coordinate of a human's; of other bodies in proportion."""


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
    builder = TreeBuilder(skeleton, sides)
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
    folder = files("posefuse.skeleton").joinpath("bodies")
    known = sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))
    if name not in known:
        raise SkeletonError(f"No body {name!r} to take a tree from. {suggestion(name, known)}")
    return tomllib.loads(folder.joinpath(f"{name}.toml").read_text("utf-8"))
