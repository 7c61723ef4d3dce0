"""Separately tracked parts of a body: hands and face.

A part has its own tree in a file of ``bodies/``, listed in ``parts`` of the body's table. In addition to the tables of
a tree (:mod:`posefuse.skeleton.tree_tables`) the file has:

* ``at``: body keypoint of the part's root;
* ``like``: body segment whose orientation the root shares; omitted if there is none;
* ``sides``: ``true`` for a left and a right part. Names, also in ``at``, then have no ``left_`` or ``right_``, and the
  table describes the left part.

A skeleton has a part if it has the keypoint ``at`` and three or more keypoints fixed to the part's root.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posefuse.arrays import PickledByFields, frozen
from posefuse.errors import SkeletonError, suggestion
from posefuse.skeleton.tree_tables import parse_tree, shared_body
from posefuse.skeleton.trees import Tree, sided

_OWN = ("at", "like", "sides")
_LEAST_POINTS = 3
"""Fewer do not determine the orientation of the root."""


@dataclass(frozen=True, eq=False)
class Part(PickledByFields):
    """A separately tracked part of a body.

    Attributes:
        name: name such as ``left_hand``.
        at: index of the skeleton's keypoint at the root.
        like: index of the body segment whose orientation the root shares, -1 for none.
        keypoints: shape (point,), int64: indices of the part's keypoints in the skeleton.
        tree: tree of these keypoints.
    """

    name: str
    at: int
    like: int
    keypoints: np.ndarray
    tree: Tree


def parse_parts(
    body: object, tree: Tree | None, keypoints: Sequence[str], partner: Mapping[str, str], skeleton: str
) -> tuple[Part, ...]:
    """Return the parts of which a skeleton has keypoints.

    Args:
        body: table of the body's tree.
        tree: tree built from it, or None.
        keypoints: keypoints of the skeleton.
        partner: left name to right name.
        skeleton: name of the skeleton, for messages.

    Raises:
        SkeletonError: if the table is invalid or contains unknown names.
    """
    names = body.get("parts", []) if isinstance(body, Mapping) else []
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SkeletonError(f"Skeleton {skeleton!r}: tree.parts must be a list of part names, got {names!r}.")
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
    """Return one part, or None if the skeleton has too few of its keypoints."""
    before = f"{side}_" if side else ""
    at, like = f"{before}{table['at']}", table.get("like")
    if like is not None and like not in body.segments:
        raise SkeletonError(f"Part {name!r}: unknown segment {like!r} in like. {suggestion(like, body.segments)}")
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
