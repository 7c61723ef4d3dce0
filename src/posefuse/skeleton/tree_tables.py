"""Parse kinematic trees from TOML tables.

A tree is the table ``[tree]`` of a skeleton's TOML, or one of the files in ``bodies/`` that several skeletons share
(``tree = "human"``), restricted to branches with keypoints of the skeleton. Its tables:

* ``segments``: name to ``{at = point}``; each rotates freely about a point. The first is the root and has no ``at``;
  its origin is a point of the same name.
* ``points``: name to ``[segment, forward, left, up]``, meters, of an adult: points fixed to a segment. A coordinate of
  exactly 0 stays 0, others are person-specific. With a point instead of a segment: a constant offset from that point,
  in the axes of its segment.
* ``bones``: name of the distal point to ``[proximal point, length]`` or ``[point, length, [forward, left, up]]`` with
  the rest direction (default: down). Only the direction of a bone is observable.
* ``hinges``: distal end of a bone to ``[segment, axis]``, in the segment's axes: the cross product of the previous bone
  and this one points along the axis.
* ``cones``: distal end of a bone to ``[segment, axis, degrees]``: largest angle from the axis.
* ``twists``: name of a segment to ``[segment, axis, degrees]``: largest angle of the axis between the two segments; or
  a list of such rows. A segment whose points lie on a line needs a limit of an axis across it, because no view shows
  how far it has turned about that line.
* ``spread``, ``size_spread``: relative variation of lengths between people, each and all together.
* ``size_m``: body size, default 1.75; lengths in options refer to an adult human and are scaled.
* ``offset_factor``: distance between keypoints and the joints of the body, relative to a human of the same size;
  default 1, more where skin slides.
* ``least_sd_m``: smallest variation of a point's coordinates between people, default 0.015 for an adult.
* ``parts``: files of ``bodies/`` with separately tracked parts, see :mod:`posefuse.skeleton.parts`.

Points are keypoints of the skeleton or joints that no detector reports. Entries of the left side are reflected to the
right. A table with ``size_m`` only turns the edges of the skeleton into a tree of bones.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import Any

from posefuse.errors import SkeletonError, suggestion
from posefuse.skeleton.tree_builder import TreeBuilder
from posefuse.skeleton.trees import ADULT_M, Tree

_TABLES = ("segments", "points", "bones", "hinges", "cones", "twists")
_NUMBERS = ("spread", "size_spread", "size_m", "least_sd_m", "offset_factor")
_ROWS = {
    "points": "[segment or point, forward, left, up]",
    "bones": "[point, length] or [point, length, [forward, left, up]]",
    "hinges": "[segment, [forward, left, up]]",
    "cones": "[segment, [forward, left, up], degrees]",
    "twists": "[segment, [forward, left, up], degrees] or a list of such rows",
}
_SPREAD, _SIZE_SPREAD = 0.08, 0.07
_LEAST_SD = 0.015
"""For a human; scaled for other bodies."""


def parse_tree(table: Mapping[str, Any], keypoints: Sequence[str], partner: Mapping[str, str], skeleton: str) -> Tree:
    """Build a tree from its table in a skeleton's TOML.

    Args:
        table: table ``[tree]``.
        keypoints: keypoints of the skeleton.
        partner: left name to right name.
        skeleton: name of the skeleton, for messages.

    Raises:
        SkeletonError: if the table is invalid or contains unknown names.
    """
    _check_tables(table, skeleton)
    segments: Mapping[str, Any] = table["segments"]
    mirrored = {f"left_{name[5:]}" for name in segments if f"right_{name[5:]}" in segments and name.startswith("left_")}
    sides = {**partner, **{name: f"right_{name[5:]}" for name in mirrored}}
    points, bones = _relevant_nodes(keypoints, segments, table.get("points", {}), table.get("bones", {}), sides)
    used = {_segment_of(row, points) for row in points.values()}
    used |= {sides.get(name, name) for name in used}
    segments = {name: at for i, (name, at) in enumerate(segments.items()) if i == 0 or name in used}
    builder = TreeBuilder(skeleton, sides)
    builder.add_segments(segments, points, bones)
    limits = (
        *builder.hinges(_relevant_limits(table.get("hinges", {}), bones, segments)),
        *builder.cones(_relevant_limits(table.get("cones", {}), bones, segments)),
        *builder.twists(_relevant_twists(table.get("twists", {}), segments)),
    )
    size_m = float(table.get("size_m", ADULT_M))
    spreads = float(table.get("spread", _SPREAD)), float(table.get("size_spread", _SIZE_SPREAD))
    least_sd_m = float(table.get("least_sd_m", _LEAST_SD * size_m / ADULT_M))
    tree = builder.finish(keypoints, limits, spreads, least_sd_m, size_m)
    return replace(tree, offset_factor=float(table.get("offset_factor", 1.0)))


def _check_tables(table: Mapping[str, Any], skeleton: str) -> None:
    """Raise an error if the tables do not define a tree."""
    where = f"Skeleton {skeleton!r}: tree"
    _check_names_and_numbers(table, where)
    _check_segments(table.get("segments", {}), where)
    segments, bones = table["segments"], table.get("bones", {})
    beside = {**segments, **{n: row for n, row in table.get("points", {}).items() if row and row[0] in segments}}
    for key in _ROWS:
        for name, value in table.get(key, {}).items():
            for row in _twist_rows(value) if key == "twists" else [value]:
                _check_row(key, name, row, segments, bones, beside, where)
    for name in table.get("points", {}):
        if name in bones or name == next(iter(segments)):
            raise SkeletonError(f"{where}: {name!r} is defined twice; expected a root, a fixed point or a bone's end.")


def _check_names_and_numbers(table: Mapping[str, Any], where: str) -> None:
    known = (*_TABLES, *_NUMBERS, "parts")
    for key in table:
        if key not in known:
            raise SkeletonError(f"{where}: unknown table {key!r}. {suggestion(key, known)}")
    for key in _NUMBERS:
        value = table.get(key, 1.0)
        if not _is_number(value) or not value > 0.0:
            raise SkeletonError(f"{where}.{key} must be a positive number, got {value!r}.")


def _check_segments(segments: Mapping[str, Any], where: str) -> None:
    if not segments:
        raise SkeletonError(f"{where} has no segments; at least one is needed, and the first is the root.")
    for i, (name, row) in enumerate(segments.items()):
        if not isinstance(row, Mapping) or set(row) != (set() if i == 0 else {"at"}):
            expected = "{}, because it is the root" if i == 0 else '{ at = "the point about which it rotates" }'
            raise SkeletonError(f"{where}.segments.{name} must be {expected}; got {row!r}.")
        if name.startswith("left_") and f"right_{name[5:]}" not in segments:
            raise SkeletonError(f"{where}.segments has {name!r} but no 'right_{name[5:]}'; define both.")


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
        raise SkeletonError(f"{where}.{table}.{name} must be {_ROWS[table]} with positive lengths; got {row!r}.")
    known = segments if table == "twists" else bones
    if table in ("hinges", "cones", "twists") and name not in known:
        kind = "a segment" if table == "twists" else "the end of a bone"
        raise SkeletonError(f"{where}.{table} contains {name!r}, which is not {kind}. {suggestion(name, known)}")
    if table != "bones" and row[0] not in (segments if table != "points" else beside):
        raise SkeletonError(f"{where}.{table}.{name}: unknown segment {row[0]!r}. {suggestion(row[0], segments)}")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_row(table: str, row: object) -> bool:
    """Return whether a row has the form listed in ``_ROWS``."""
    if not isinstance(row, list) or not row or not isinstance(row[0], str):
        return False
    numbers = [_is_number(x) for x in row[1:]]
    axes = [isinstance(x, list) and len(x) == 3 and all(map(_is_number, x)) and any(x) for x in row[1:]]
    if table == "points":
        return numbers == [True] * 3
    if table == "bones":
        return numbers[:1] == [True] and row[1] > 0.0 and axes[1:] in ([], [True])
    return axes[:1] == [True] and numbers[1:] == ([] if table == "hinges" else [True])


def _relevant_limits(table: Mapping[str, Any], ends: Mapping[str, Any], segments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the limits of the bones and segments in use."""
    return {name: row for name, row in table.items() if name in ends and row[0] in segments}


def _twist_rows(value: Any) -> list[Any]:
    """Return the rows of a segment in the table ``twists``: its only row, or all rows of a list."""
    return value if isinstance(value, list) and value and all(isinstance(row, list) for row in value) else [value]


def _relevant_twists(table: Mapping[str, Any], segments: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return the rows of the segments in use, each with the name of its segment."""
    rows = [(name, row) for name, value in table.items() for row in _twist_rows(value)]
    return [(name, row) for name, row in rows if name in segments and row[0] in segments]


def _segment_of(row: Sequence[Any], points: Mapping[str, Any]) -> str:
    """Return the segment to which a point is fixed, directly or by another point."""
    return str(points[row[0]][0]) if row[0] in points else str(row[0])


def _relevant_nodes(
    keypoints: Sequence[str],
    segments: Mapping[str, Any],
    points: Mapping[str, Any],
    bones: Mapping[str, Any],
    partner: Mapping[str, str],
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the points and bones that are keypoints or ancestors of keypoints."""
    parent_of = {
        name: str(dict(segments[row[0]]).get("at", "")) if row[0] in segments else str(row[0])
        for name, row in points.items()
    }
    parent_of.update({name: str(row[0]) for name, row in bones.items()})
    needed: set[str] = set()
    for name in parent_of:
        here = name if name in keypoints or partner.get(name) in keypoints else ""
        while here and here not in needed:
            needed.add(here)
            here = parent_of.get(here, "")
    return {n: r for n, r in points.items() if n in needed}, {n: r for n, r in bones.items() if n in needed}


@cache
def shared_body(name: str) -> Mapping[str, Any]:
    """Return the tables of a body shared by several skeletons.

    Raises:
        SkeletonError: if there is no body of that name.
    """
    folder = files("posefuse.skeleton").joinpath("bodies")
    known = sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))
    if name not in known:
        raise SkeletonError(f"Unknown shared body {name!r}. {suggestion(name, known)}")
    return tomllib.loads(folder.joinpath(f"{name}.toml").read_text("utf-8"))
