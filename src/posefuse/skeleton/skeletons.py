"""Skeletons: which keypoints there are, and how they belong together.

A skeleton is a TOML file; the shipped ones stand in the folder ``skeletons`` beside this module. Its tables:

* ``name``, ``description``;
* ``keypoints``: canonical names, snake_case with ``left_`` / ``right_`` as in COCO; ``"face_{00..67}"`` stands for 68;
* ``edges``: pairs of names to draw, and whose lengths are bones;
* ``rigid``: those of the edges that keep their length whatever the body does, and with them those of the other side;
* ``core``: keypoints that a new person is told by; where absent, all of them;
* ``pairs``: (left, right) names; where absent, every ``left_x`` that has a ``right_x``;
* ``[chains]``: limbs whose sides are mixed up together, each a list of left names (partners by ``pairs``);
* ``[derived]``: keypoints that are the mean of others, for mapping from a skeleton that lacks them;
* ``plausible_m``: rows of two names and the shortest and longest distance a body has between them, in metres;
* ``tree``: how the body turns and how large it is, see :mod:`posefuse.skeleton.tree_tables`;
* ``[names]``: other programs' names for the keypoints, in the same order.
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

from posefuse.arrays import Rebuilt, frozen
from posefuse.errors import SkeletonError, choices, suggestion
from posefuse.skeleton.parts import Part, parse_parts
from posefuse.skeleton.tree_tables import parse_tree, shared_body
from posefuse.skeleton.trees import Tree
from posefuse.skeleton.trees_from_edges import tree_of_size

_KEYS = (
    "name", "description", "keypoints", "core", "edges", "rigid", "pairs", "chains", "derived", "plausible_m", "tree",
    "names",
)  # fmt: skip


@dataclass(frozen=True)
class Skeleton(Rebuilt):
    """Keypoint names and their relations.

    Attributes:
        name: of the skeleton.
        keypoints: names, in the order of every keypoint axis.
        edges: pairs of names that a bone or a drawn line joins.
        pairs: (left, right) names.
        chains: limb name to (left, right) pairs from the trunk outwards.
        derived: name to the names it is the mean of.
        plausible_m: two names, and the shortest and longest distance a body has between them, in metres.
        names: another program to its names of the keypoints, in order.
        description: a sentence.
        tree: how the body turns, or None where the file does not say.
        core: names of the keypoints that a new person is told by; empty where all are.
        parts: what is followed for itself, given where the body has it: hands, the face.
        rigid: those of the edges that keep their length whatever the body does, of both sides.

    Raises:
        SkeletonError: where a table names a keypoint that is not there, or one twice, or what is rigid is no edge.
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

    def __post_init__(self) -> None:
        repeated = sorted({name for name in self.keypoints if self.keypoints.count(name) > 1})
        if repeated:
            raise SkeletonError(f"Skeleton {self.name!r} names keypoints twice: {choices(repeated)}.")
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
                raise SkeletonError(f"Skeleton {self.name!r}: rigid names {a!r} and {b!r}, which no edge joins.")
        self._check_names("core", self.core)
        if len(set(self.core)) != len(self.core):
            raise SkeletonError(f"Skeleton {self.name!r}: core names a keypoint twice: {choices(self.core)}.")
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
        """The place of a keypoint.

        Raises:
            SkeletonError: if there is no such keypoint.
        """
        if keypoint not in self.keypoints:
            raise SkeletonError(
                f"Skeleton {self.name!r} has no keypoint {keypoint!r}. {suggestion(keypoint, self.keypoints)}"
            )
        return self.keypoints.index(keypoint)

    @cached_property
    def edge_indices(self) -> np.ndarray:
        """Shape (edge, 2), int64."""
        return frozen(np.array([[self.index(a), self.index(b)] for a, b in self.edges]).reshape(-1, 2), np.int64)

    @cached_property
    def pair_indices(self) -> np.ndarray:
        """Shape (pair, 2), int64: left and right."""
        return frozen(np.array([[self.index(a), self.index(b)] for a, b in self.pairs]).reshape(-1, 2), np.int64)

    @cached_property
    def core_indices(self) -> np.ndarray:
        """Shape (core,), int64: places of the keypoints that a new person is told by, all where none are named."""
        return frozen(np.array([self.index(name) for name in self.core or self.keypoints]), np.int64)

    @cached_property
    def core_mirror(self) -> np.ndarray:
        """Shape (core,), int64: among the core keypoints each one's partner on the other side, else itself."""
        core = self.core_indices.tolist()
        partners = self.mirror[core].tolist()
        return frozen(np.array([core.index(b) if b in core else i for i, b in enumerate(partners)]), np.int64)

    @cached_property
    def core_bones(self) -> np.ndarray:
        """Shape (bone, 4): of ``plausible_m`` within the core, two places there and the two distances in m."""
        core = self.core_indices.tolist()
        bones = [(self.index(a), self.index(b), low, high) for a, b, low, high in self.plausible_m]
        kept = [(core.index(a), core.index(b), low, high) for a, b, low, high in bones if a in core and b in core]
        return frozen(np.array(kept).reshape(-1, 4))

    @cached_property
    def mirror(self) -> np.ndarray:
        """Shape (keypoint,), int64: each keypoint's partner on the other side, itself where it has none."""
        partner = np.arange(len(self))
        for left, right in self.pairs:
            a, b = self.index(left), self.index(right)
            partner[a], partner[b] = b, a
        return frozen(partner, np.int64)

    @cached_property
    def stood_names(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
        """Names of segments, bones and lengths: of the tree, then of the parts."""
        trees = [tree for tree in (self.tree, *(part.tree for part in self.parts)) if tree is not None]
        segments = tuple(name for tree in trees for name in tree.segments)
        bones = tuple(name for tree in trees for name in tree.bones)
        return segments, bones, tuple(name for tree in trees for name in tree.shape_names)

    def canonical(self, name: str) -> str | None:
        """The keypoint that some program calls ``name``, or None."""
        if name in self.keypoints:
            return name
        for names in self.names.values():
            if name in names:
                return self.keypoints[names.index(name)]
        return None

    def sources_of(self, other: "Skeleton") -> dict[str, tuple[str, ...]]:
        """How keypoints of ``other`` follow from this skeleton's: each name to the names whose mean it is.

        Keypoints that both have map to themselves; derived ones of ``other`` to their parts where all of them are
        here. Keypoints that cannot be had are left out.
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
    """The names of the skeletons that come with posefuse."""
    folder = files("posefuse.skeleton").joinpath("skeletons")
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


@cache
def shipped_skeleton(name: str) -> Skeleton:
    """A skeleton that comes with posefuse, by name (``coco_17`` and ``COCO-17`` alike).

    Raises:
        SkeletonError: if there is none of that name.
    """
    plain = re.sub(r"[^a-z0-9]", "", name.lower())
    for candidate in shipped_skeletons():
        if candidate.replace("_", "") == plain:
            text = files("posefuse.skeleton").joinpath("skeletons", f"{candidate}.toml").read_text("utf-8")
            return parse_skeleton(text, f"{candidate}.toml")
    raise SkeletonError(
        f"No skeleton {name!r}. {suggestion(name, shipped_skeletons())} A path to a skeleton's TOML file works too."
    )


def find_skeleton(name: str | Path | Skeleton) -> Skeleton:
    """A skeleton by name, by the path of its TOML file, or itself.

    Raises:
        SkeletonError: if there is none, or the file does not describe one.
    """
    if isinstance(name, Skeleton):
        return name
    path = Path(name)
    if path.suffix != ".toml":
        return shipped_skeleton(str(name))
    if not path.is_file():
        raise SkeletonError(f"No skeleton file {path}. The shipped ones: {choices(shipped_skeletons(), 20)}.")
    return parse_skeleton(path.read_text("utf-8"), path.name)


def parse_skeleton(text: str, source: str) -> Skeleton:
    """A skeleton from the text of its TOML file.

    Raises:
        SkeletonError: where the text does not describe one.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SkeletonError(f"{source} is not TOML: {error}.") from None
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
                raise SkeletonError(f"{source}: each of the {key} is two different names, got {row}.")
    pairs = _pairs(data["pairs"]) if "pairs" in data else _pairs_by_name(keypoints)
    partner = dict(pairs)
    chains: dict[str, tuple[tuple[str, str], ...]] = {}
    for limb, left_names in data.get("chains", {}).items():
        for left in left_names:
            if left not in partner:
                raise SkeletonError(f"{source}: chain {limb!r} names {left!r}, which is the left of no pair.")
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
    """What a skeleton says of its tree: the table itself, or that of a shared body."""
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
        raise SkeletonError(f"Skeleton {skeleton!r}: tree is a table or the name of a shared body, got {table!r}.")
    if set(body) == {"size_m"}:
        return _tree_of_edges(body["size_m"], Skeleton(skeleton, keypoints, edges, tuple(partner.items())))
    # Joints that no detector sees have sides too.
    hidden = [
        str(name) for table in ("points", "bones") for name in body.get(table, {}) if str(name).startswith("left_")
    ]
    sides = {name: f"right_{name[5:]}" for name in hidden}
    return parse_tree(body, keypoints, {**sides, **partner}, skeleton)


def _tree_of_edges(size_m: object, skeleton: Skeleton) -> Tree:
    if not isinstance(size_m, int | float) or not 0.0 < size_m < math.inf:
        raise SkeletonError(f"Skeleton {skeleton.name!r}: tree.size_m is a positive number, got {size_m!r}.")
    if not skeleton.edges:
        raise SkeletonError(
            f"Skeleton {skeleton.name!r} has a tree of which only the size is known, but no edges to be its bones: "
            "give edges."
        )
    return tree_of_size(skeleton.keypoints, skeleton.edge_indices, float(size_m), skeleton.mirror)


def _names(value: object, where: str) -> list[str]:
    if not isinstance(value, list) or not all(isinstance(name, str) and name for name in value):
        raise SkeletonError(f"{where}: expected a list of names, got {value!r}.")
    return value


def _expand(names: list[str]) -> tuple[str, ...]:
    """Names with ranges written out: ``"face_{00..67}"`` is 68 names, padded with zeros as the first number is."""
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
    """Rows of two names; a row ``["face_{00..02}", "face_{01..03}"]`` stands for three."""
    out: list[tuple[str, str]] = []
    for row in rows:
        out.extend(zip(_expand([row[0]]), _expand([row[1]]), strict=True))
    return tuple(out)


def _pairs_by_name(keypoints: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    lefts = [name for name in keypoints if name.startswith("left_")]
    return tuple((left, f"right_{left[5:]}") for left in lefts if f"right_{left[5:]}" in keypoints)
