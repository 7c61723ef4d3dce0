"""Skeletons: keypoint names and their relations.

A skeleton is a TOML file; the shipped ones are in the folder ``skeletons`` beside this module. Its tables:

* ``name``, ``description``;
* ``keypoints``: canonical names, snake_case with ``left_`` / ``right_`` as in COCO; ``"face_{00..67}"`` stands for 68;
* ``edges``: pairs of names: bones, and lines to draw;
* ``rigid``: edges with constant length, and their mirror images;
* ``core``: keypoints that identify a person; default: all;
* ``pairs``: (left, right) names; default: every ``left_x`` with a ``right_x``;
* ``[chains]``: limbs whose sides are swapped together, each a list of left names (partners from ``pairs``);
* ``[derived]``: keypoints that are the mean of others, for conversion from a skeleton without them;
* ``plausible_m``: rows of two names and the smallest and largest distance between them, in meters;
* ``tree``: the kinematic tree and the body size, see :mod:`posefuse.skeleton.tree_tables`;
* ``[names]``: names of the keypoints in other programs, in the same order.
"""

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import PickledByFields, frozen
from posefuse.described import Described, Description, count
from posefuse.described import names as listed
from posefuse.errors import SkeletonError, choices, suggestion
from posefuse.skeleton.parts import Part, parse_parts
from posefuse.skeleton.tree_tables import parse_tree, shared_body
from posefuse.skeleton.trees import Tree
from posefuse.skeleton.trees_from_edges import tree_of_size

_KEYS = (
    "name", "description", "keypoints", "core", "edges", "rigid", "pairs", "chains", "derived", "plausible_m", "tree",
    "names",
)  # fmt: skip


@checked
@dataclass(frozen=True, repr=False)
class Skeleton(Described, PickledByFields):
    """Keypoint names and their relations.

    Attributes:
        name: name of the skeleton.
        keypoints: names, in the order of the keypoint axes.
        edges: pairs of names joined by a bone or a drawn line.
        pairs: (left, right) names.
        chains: limb name to (left, right) pairs from the trunk outward.
        derived: name to the names whose mean it is.
        plausible_m: two names, and the smallest and largest distance between them, in meters.
        names: program to its names of the keypoints, in order.
        description: one sentence.
        tree: kinematic tree, or None without one.
        core: names of the keypoints that identify a person; empty means all.
        parts: separately tracked parts: hands and face.
        rigid: edges with constant length, on both sides.

    Raises:
        SkeletonError: if a table names an unknown keypoint or one twice, or a rigid pair is not an edge.
    """

    name: str
    keypoints: tuple[str, ...]
    edges: tuple[tuple[str, str], ...] = ()
    pairs: tuple[tuple[str, str], ...] = ()
    chains: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)
    derived: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    plausible_m: tuple[tuple[str, str, float, float], ...] = ()
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    description: str = ""
    core: tuple[str, ...] = ()
    tree: Tree | None = field(default=None, compare=False)
    parts: tuple[Part, ...] = field(default=(), compare=False)
    rigid: tuple[tuple[str, str], ...] = ()

    def _description(self) -> Description:
        title = f"Skeleton {self.name}: {count(len(self), 'keypoint')}, {count(len(self.edges), 'edge')}"
        rows = [("keypoints", listed(self.keypoints)), ("parts", listed([part.name for part in self.parts]))]
        return Description(title, tuple(row for row in rows if row[1]))

    def __post_init__(self) -> None:
        repeated = sorted({name for name in self.keypoints if self.keypoints.count(name) > 1})
        if repeated:
            raise SkeletonError(f"Skeleton {self.name!r} repeats keypoints: {choices(repeated)}.")
        if not self.keypoints:
            raise SkeletonError(f"Skeleton {self.name!r} has no keypoints.")
        chained = [pair for chain in self.chains.values() for pair in chain]
        bones = [(a, b) for a, b, _, _ in self.plausible_m]
        tables = (("edges", self.edges), ("pairs", self.pairs), ("chains", chained), ("plausible_m", bones))
        for table, pairs in tables:
            for pair in pairs:
                self._check_names(table, pair)
        joined = {frozenset(edge) for edge in self.edges}
        for a, b in self.rigid:
            if frozenset((a, b)) not in joined:
                raise SkeletonError(f"Skeleton {self.name!r}: rigid contains {a!r} and {b!r}, which no edge connects.")
        self._check_names("core", self.core)
        if len(set(self.core)) != len(self.core):
            raise SkeletonError(f"Skeleton {self.name!r}: core repeats a keypoint: {choices(self.core)}.")
        for program, names in self.names.items():
            if len(names) != len(self.keypoints):
                raise SkeletonError(
                    f"Skeleton {self.name!r}: names.{program} has {len(names)} names for {len(self)} keypoints."
                )

    def _check_names(self, table: str, names: tuple[str, ...]) -> None:
        for name in names:
            if name not in self.keypoints:
                raise SkeletonError(
                    f"Skeleton {self.name!r}: {table} names {name!r}, which is not a keypoint. "
                    f"{suggestion(name, self.keypoints)}"
                )

    def __len__(self) -> int:
        return len(self.keypoints)

    def index(self, keypoint: str) -> int:
        """Return the index of a keypoint.

        Raises:
            SkeletonError: if the skeleton has no such keypoint.
        """
        if keypoint not in self.keypoints:
            raise SkeletonError(
                f"Skeleton {self.name!r} has no keypoint {keypoint!r}. {suggestion(keypoint, self.keypoints)}"
            )
        return self.keypoints.index(keypoint)

    @cached_property
    def edge_indices(self) -> np.ndarray:
        """Shape (edge, 2), int64: keypoint indices of the edges."""
        return frozen(np.array([[self.index(a), self.index(b)] for a, b in self.edges]).reshape(-1, 2), np.int64)

    @cached_property
    def pair_indices(self) -> np.ndarray:
        """Shape (pair, 2), int64: keypoint indices, left and right."""
        return frozen(np.array([[self.index(a), self.index(b)] for a, b in self.pairs]).reshape(-1, 2), np.int64)

    @cached_property
    def core_indices(self) -> np.ndarray:
        """Shape (core,), int64: indices of the core keypoints, all if none are named."""
        return frozen(np.array([self.index(name) for name in self.core or self.keypoints]), np.int64)

    @cached_property
    def core_mirror(self) -> np.ndarray:
        """Shape (core,), int64: index, within the core, of each keypoint's mirror image, or of itself."""
        core = self.core_indices.tolist()
        partners = self.mirror[core].tolist()
        return frozen(np.array([core.index(b) if b in core else i for i, b in enumerate(partners)]), np.int64)

    @cached_property
    def core_bones(self) -> np.ndarray:
        """Shape (bone, 4): rows of ``plausible_m`` within the core: two core indices and the two distances in m."""
        core = self.core_indices.tolist()
        bones = [(self.index(a), self.index(b), low, high) for a, b, low, high in self.plausible_m]
        kept = [(core.index(a), core.index(b), low, high) for a, b, low, high in bones if a in core and b in core]
        return frozen(np.array(kept).reshape(-1, 4))

    @cached_property
    def mirror(self) -> np.ndarray:
        """Shape (keypoint,), int64: index of each keypoint's mirror image, or of itself."""
        partner = np.arange(len(self))
        for left, right in self.pairs:
            a, b = self.index(left), self.index(right)
            partner[a], partner[b] = b, a
        return frozen(partner, np.int64)

    @cached_property
    def modeled(self) -> np.ndarray:
        """Whether the kinematic tree or a part has a node for each keypoint, shape (keypoint,), bool."""
        modeled = np.zeros(len(self), dtype=bool)
        if self.tree is not None:
            modeled |= self.tree.keypoint_nodes >= 0
        for part in self.parts:
            modeled[part.keypoints] = True
        return modeled

    @cached_property
    def unmodeled(self) -> tuple[str, ...]:
        """Names of the keypoints that have an edge, but no node in the kinematic tree and the parts."""
        if self.tree is None:
            return ()
        ends = set(self.edge_indices.ravel().tolist())
        return tuple(self.keypoints[k] for k in np.flatnonzero(~self.modeled).tolist() if k in ends)

    @cached_property
    def body_names(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
        """Names of segments, bones and lengths, of the tree and then of the parts."""
        trees = [tree for tree in (self.tree, *(part.tree for part in self.parts)) if tree is not None]
        segments = tuple(name for tree in trees for name in tree.segments)
        bones = tuple(name for tree in trees for name in tree.bones)
        return segments, bones, tuple(name for tree in trees for name in tree.shape_names)

    def canonical(self, name: str) -> str | None:
        """Return the keypoint that any known program calls ``name``, or None."""
        if name in self.keypoints:
            return name
        for names in self.names.values():
            if name in names:
                return self.keypoints[names.index(name)]
        return None

    def sources_of(self, other: "Skeleton") -> dict[str, tuple[str, ...]]:
        """Map keypoints of ``other`` to the keypoints of this skeleton whose mean they are.

        Common keypoints map to themselves, derived ones of ``other`` to their parts if all exist here. Other
        keypoints are omitted.
        """
        found: dict[str, tuple[str, ...]] = {}
        for name in other.keypoints:
            parts = other.derived.get(name, ())
            if name in self.keypoints:
                found[name] = (name,)
            elif parts and all(part in self.keypoints for part in parts):
                found[name] = tuple(parts)
        return found


@cache
def shipped_skeletons() -> tuple[str, ...]:
    """Return the names of the shipped skeletons."""
    folder = files("posefuse.skeleton").joinpath("skeletons")
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


@cache
def shipped_skeleton(name: str) -> Skeleton:
    """Return a shipped skeleton by name (``coco_17`` and ``COCO-17`` are equivalent).

    Raises:
        SkeletonError: if there is no skeleton of that name.
    """
    plain = re.sub(r"[^a-z0-9]", "", name.lower())
    for candidate in shipped_skeletons():
        if candidate.replace("_", "") == plain:
            text = files("posefuse.skeleton").joinpath("skeletons", f"{candidate}.toml").read_text("utf-8")
            return parse_skeleton(text, f"{candidate}.toml")
    raise SkeletonError(
        f"Unknown skeleton {name!r}. {suggestion(name, shipped_skeletons())} Or specify the path of a TOML file."
    )


@checked
def find_skeleton(name: str | Path | Skeleton) -> Skeleton:
    """Return a skeleton by name or by the path of its TOML file; a skeleton is returned unchanged.

    Raises:
        SkeletonError: if it does not exist, or the file is invalid.
    """
    if isinstance(name, Skeleton):
        return name
    path = Path(name)
    if path.suffix != ".toml":
        return shipped_skeleton(str(name))
    if not path.is_file():
        raise SkeletonError(
            f"There is no skeleton file {path}. The shipped skeletons are {choices(shipped_skeletons(), 20)}."
        )
    return parse_skeleton(path.read_text("utf-8"), path.name)


def parse_skeleton(text: str, source: str) -> Skeleton:
    """Parse the text of a skeleton's TOML file.

    Raises:
        SkeletonError: if the text is not a valid skeleton.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SkeletonError(f"{source} is not valid TOML: {error}.") from None
    for key in data:
        if key not in _KEYS:
            raise SkeletonError(f"{source}: unknown table {key!r}. {suggestion(key, _KEYS)}")
    for key in ("name", "keypoints"):
        if key not in data:
            raise SkeletonError(f"{source}: a skeleton needs {key!r}; it has {choices(data)}.")
    keypoints = _expand(_names(data["keypoints"], f"{source}: keypoints"))
    for key in ("edges", "rigid", "pairs"):
        for row in data.get(key, []):
            if len(_names(row, f"{source}: each of the {key}")) != 2 or row[0] == row[1]:
                raise SkeletonError(f"{source}: each of the {key} must be two different names, got {row}.")
    pairs = _pairs(data["pairs"]) if "pairs" in data else _pairs_by_name(keypoints)
    partner = dict(pairs)
    chains: dict[str, tuple[tuple[str, str], ...]] = {}
    for limb, left_names in data.get("chains", {}).items():
        for left in left_names:
            if left not in partner:
                raise SkeletonError(
                    f"{source}: chain {limb!r} contains {left!r}, which is not the left name of a pair."
                )
        chains[limb] = tuple((left, partner[left]) for left in left_names)
    return Skeleton(
        name=data["name"],
        keypoints=keypoints,
        edges=_pairs(data.get("edges", [])),
        pairs=pairs,
        chains=chains,
        derived={name: tuple(parts) for name, parts in data.get("derived", {}).items()},
        plausible_m=tuple((a, b, float(low), float(high)) for a, b, low, high in data.get("plausible_m", [])),
        names={program: _expand(names) for program, names in data.get("names", {}).items()},
        description=data.get("description", ""),
        tree=(tree := _tree(data.get("tree"), keypoints, _pairs(data.get("edges", [])), partner, data["name"])),
        core=_expand(_names(data.get("core", []), f"{source}: core")),
        parts=parse_parts(_body(data.get("tree")), tree, keypoints, partner, data["name"]),
        rigid=_of_both_sides(_pairs(data.get("rigid", [])), partner),
    )


def _of_both_sides(edges: tuple[tuple[str, str], ...], partner: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    mirrored = ((partner.get(a, a), partner.get(b, b)) for a, b in edges)
    return tuple(dict.fromkeys((*edges, *mirrored)))


def _body(table: object) -> object:
    """Return the tree's table, or that of a shared body."""
    return shared_body(table) if isinstance(table, str) else table


def _tree(
    table: object,
    keypoints: tuple[str, ...],
    edges: tuple[tuple[str, str], ...],
    partner: Mapping[str, str],
    skeleton: str,
) -> Tree | None:
    if table is None:
        return None
    body = _body(table)
    if not isinstance(body, Mapping):
        raise SkeletonError(f"Skeleton {skeleton!r}: tree must be a table or the name of a shared body, got {table!r}.")
    if set(body) == {"size_m"}:
        return _tree_of_edges(body["size_m"], Skeleton(skeleton, keypoints, edges, tuple(partner.items())))
    # Joints that no detector reports have mirror images too.
    hidden = [
        str(name) for table in ("points", "bones") for name in body.get(table, {}) if str(name).startswith("left_")
    ]
    sides = {name: f"right_{name[5:]}" for name in hidden}
    return parse_tree(body, keypoints, {**sides, **partner}, skeleton)


def _tree_of_edges(size_m: object, skeleton: Skeleton) -> Tree:
    if not isinstance(size_m, int | float) or not 0.0 < size_m < math.inf:
        raise SkeletonError(f"Skeleton {skeleton.name!r}: tree.size_m must be a positive number, got {size_m!r}.")
    if not skeleton.edges:
        raise SkeletonError(
            f"Skeleton {skeleton.name!r} has a tree with size_m only, but no edges to use as bones. Add edges."
        )
    return tree_of_size(skeleton.keypoints, skeleton.edge_indices, float(size_m), skeleton.mirror)


def _names(value: object, where: str) -> list[str]:
    if not isinstance(value, list) or not all(isinstance(name, str) and name for name in value):
        raise SkeletonError(f"{where}: expected a list of names, got {value!r}.")
    return value


def _expand(names: list[str]) -> tuple[str, ...]:
    """Expand ranges in names: ``"face_{00..67}"`` becomes 68 names, zero-padded like the first number."""
    out: list[str] = []
    for name in names:
        match = re.fullmatch(r"(.*)\{(\d+)\.\.(\d+)\}(.*)", name)
        if match is None:
            out.append(name)
            continue
        head, first, last, tail = match.groups()
        out.extend(f"{head}{i:0{len(first)}d}{tail}" for i in range(int(first), int(last) + 1))
    return tuple(out)


def _pairs(rows: list[list[str]]) -> tuple[tuple[str, str], ...]:
    """Expand rows of two names; ``["face_{00..02}", "face_{01..03}"]`` becomes three rows."""
    out: list[tuple[str, str]] = []
    for row in rows:
        out.extend(zip(_expand([row[0]]), _expand([row[1]]), strict=True))
    return tuple(out)


def _pairs_by_name(keypoints: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    lefts = [name for name in keypoints if name.startswith("left_")]
    return tuple((left, f"right_{left[5:]}") for left in lefts if f"right_{left[5:]}" in keypoints)
