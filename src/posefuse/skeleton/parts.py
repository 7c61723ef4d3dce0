"""Parts of bodies that are followed for themselves, each given where the body has it: hands, a face.

A part is a tree of its own in a file of ``bodies/``, named by the ``parts`` of a body's table. Beside the tables of a
tree (:mod:`posefuse.skeleton.tree_tables`) the file has:

* ``at``: the keypoint of the body where the part's root is;
* ``like``: the segment of the body that the root turns with; left out where nothing of the body tells;
* ``sides``: ``true`` for a part that there are two of. Then names are without ``left_`` and ``right_``, in ``at`` too,
  and the table is the left one's.

A skeleton has a part if it has the part's ``at`` and three or more of the keypoints that ride on the part's root.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posefuse.arrays import Rebuilt, frozen
from posefuse.errors import SkeletonError, suggestion
from posefuse.skeleton.tree_tables import parse_tree, shared_body
from posefuse.skeleton.trees import Tree, sided

_OWN = ("at", "like", "sides")
_LEAST_POINTS = 3
"""Fewer do not tell how the root is turned."""


@dataclass(frozen=True, eq=False)
class Part(Rebuilt):
    """Something of a body that is followed for itself.

    Attributes:
        name: ``left_hand``.
        at: place of the skeleton's keypoint where the root is.
        like: number of the body's segment that the root turns with, -1 for none.
        keypoints: shape (point,), int64: places of the part's keypoints in the skeleton.
        tree: of these keypoints alone.
    """

    name: str
    at: int
    like: int
    keypoints: np.ndarray
    tree: Tree


def parse_parts(
    body: object, tree: Tree | None, keypoints: Sequence[str], partner: Mapping[str, str], skeleton: str
) -> tuple[Part, ...]:
    """The parts of a body that a skeleton has keypoints of.

    Args:
        body: the table of the body's tree.
        tree: made of it, or None.
        keypoints: of the skeleton.
        partner: left name to right name.
        skeleton: its name, for messages.

    Raises:
        SkeletonError: where the table names what is not there.
    """
    names = body.get("parts", []) if isinstance(body, Mapping) else []
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SkeletonError(f"Skeleton {skeleton!r}: tree.parts is a list of names of bodies, got {names!r}.")
    if tree is None:
        return ()
    found = []
    for name in names:
        table = shared_body(name)
        for side in ("left", "right") if table.get("sides", False) else ("",):
            part = _part(name, side, table, tree, keypoints, partner)
            if part is not None:
                found.append(part)
    return tuple(found)


def _part(
    name: str, side: str, table: Mapping[str, Any], body: Tree, keypoints: Sequence[str], partner: Mapping[str, str]
) -> Part | None:
    """One part, None where the skeleton has too little of it."""
    before = f"{side}_" if side else ""
    at, like = f"{before}{table['at']}", table.get("like")
    if like is not None and like not in body.segments:
        raise SkeletonError(f"Part {name!r} turns like {like!r}. {suggestion(like, body.segments)}")
    own = {key: value for key, value in table.items() if key not in _OWN}
    root, points = next(iter(own["segments"])), own["points"]
    mine = [k for k in keypoints if k.startswith(before) and k.removeprefix(before) in {*points, *own.get("bones", {})}]
    if not side:
        mirrored = {partner[k]: k for k in partner if k in points}
        mine = [k for k in keypoints if k in mine or k in mirrored]
    else:
        mirrored = {}
    bare = [k.removeprefix(before) for k in mine]
    riding = [k for k in bare if points.get(mirrored.get(k, k), [""])[0] == root]
    if at not in keypoints or body.keypoint_nodes[keypoints.index(at)] < 0 or len(riding) < _LEAST_POINTS:
        return None
    hidden = {k: f"right_{k[5:]}" for k in points if k.startswith("left_")}
    tree = parse_tree(own, bare, {} if side else {**hidden, **partner}, name)
    places = frozen(np.array([keypoints.index(k) for k in mine]), np.int64)
    number = -1 if like is None else body.segments.index(like)
    return Part(f"{before}{name}", keypoints.index(at), number, places, sided(tree, side) if side else tree)
