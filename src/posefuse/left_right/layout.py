"""Structure of a skeleton for the assignment of left and right: limbs, bones between pairs, and the midline."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from posefuse.skeleton.skeletons import Skeleton

_MAX_BLOCK_SIZE = 6
_MAX_UNPAIRED = 8
_MAX_MIDPOINTS = 12


@dataclass(frozen=True, eq=False)
class Layout:
    """Describe the structure of a skeleton for the assignment of left and right.

    Attributes:
        chains: names of the chains; a pair in no chain forms a chain of its own.
        chain_of: shape (pair,), int64: chain of each pair.
        blocks: pairs decided jointly, shape (J,), int64, J at most 6: a chain, or a section of a long one.
        links: shape (link, 2), int64: pairs joined by bones, on each side alike.
        within: for each block, the links inside it, shape (K,), and the bits they join, shape (K, 2).
        across: shape (A,), int64: links between two blocks.
        unpaired: shape (U,), int64: keypoints without an opposite side.
        middles: shape (M,), int64: pairs whose midpoints, after the unpaired keypoints, describe the body's midline.
        trunk: shape (pair,), bool: pairs where limbs join the trunk; their vectors are parallel at rest.
        facing: shape (3,), int64: shoulders, hips and nose among the points of the midline; empty if one is missing.
            Seen from the shoulders, the cross product of hips and nose points to the right.
    """

    chains: tuple[str, ...]
    chain_of: np.ndarray
    blocks: tuple[np.ndarray, ...]
    links: np.ndarray
    within: tuple[tuple[np.ndarray, np.ndarray], ...]
    across: np.ndarray
    unpaired: np.ndarray
    middles: np.ndarray
    trunk: np.ndarray
    facing: np.ndarray

    @classmethod
    def of(cls, skeleton: Skeleton) -> "Layout":
        """Return the layout of a skeleton from its pairs, chains and edges."""
        names, members = _chains(skeleton)
        chain_of = np.zeros(len(skeleton.pairs), dtype=np.int64)
        for c, chain in enumerate(members):
            chain_of[chain] = c
        blocks = tuple(
            np.array(chain[i : i + _MAX_BLOCK_SIZE], dtype=np.int64)
            for chain in members
            for i in range(0, len(chain), _MAX_BLOCK_SIZE)
        )
        links = _links(skeleton, members)
        block_of = np.zeros(len(skeleton.pairs), dtype=np.int64)
        for b, block in enumerate(blocks):
            block_of[block] = b
        across = np.flatnonzero(block_of[links[:, 0]] != block_of[links[:, 1]])
        within = tuple(_within(block, links) for block in blocks)
        unpaired = np.flatnonzero(skeleton.mirror == np.arange(len(skeleton)))[:_MAX_UNPAIRED]
        # Order from the trunk outward, one pair of every chain at a time.
        ranked = sorted((rank, p) for chain in members for rank, p in enumerate(chain))
        middles = np.array([p for _, p in ranked[:_MAX_MIDPOINTS]], dtype=np.int64)
        trunk = np.zeros(len(skeleton.pairs), dtype=bool)
        trunk[_roots(members)] = True
        facing = _facing(skeleton, unpaired, middles)
        return cls(names, chain_of, blocks, links, within, across, unpaired, middles, trunk, facing)


def _chains(skeleton: Skeleton) -> tuple[tuple[str, ...], list[list[int]]]:
    """Return names of the chains and their pairs from the trunk outward, then every remaining pair alone."""
    index = {pair: p for p, pair in enumerate(skeleton.pairs)}
    assigned: set[int] = set()
    names: list[str] = []
    members: list[list[int]] = []
    for name, chain in skeleton.chains.items():
        pairs = [index[pair] for pair in chain if pair in index and index[pair] not in assigned]
        if pairs:
            assigned.update(pairs)
            names.append(name)
            members.append(pairs)
    for (left, _), p in index.items():
        if p not in assigned:
            names.append(left.removeprefix("left_"))
            members.append([p])
    return tuple(names), members


def _links(skeleton: Skeleton, members: list[list[int]]) -> np.ndarray:
    """Return links between neighbors in a chain, pairs joined by an edge on one side, and the roots of all chains."""
    index = {name: (p, side) for p, pair in enumerate(skeleton.pairs) for side, name in enumerate(pair)}
    links = {tuple(sorted(two)) for chain in members for two in pairwise(chain)}
    for a, b in skeleton.edges:
        if a in index and b in index and index[a][1] == index[b][1] and index[a][0] != index[b][0]:
            links.add(tuple(sorted((index[a][0], index[b][0]))))
    limbs = _roots(members)
    for i, root in enumerate(limbs):
        links.update(tuple(sorted((root, other))) for other in limbs[:i])
    for chain in members:
        if len(chain) == 1 and chain[0] not in limbs:
            links.update(tuple(sorted((chain[0], root))) for root in limbs)
    return np.array(sorted(links), dtype=np.int64).reshape(-1, 2)


def _roots(members: list[list[int]]) -> list[int]:
    """Return the first pairs of the limbs, or the first pairs of a skeleton without limbs."""
    return [chain[0] for chain in members if len(chain) > 1][:4] or [chain[0] for chain in members][:3]


def _facing(skeleton: Skeleton, unpaired: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """Return the indices of shoulders, hips and nose among the midline points, or an empty array."""
    index = {skeleton.keypoints[k]: i for i, k in enumerate(unpaired)}
    index |= {skeleton.pairs[p][0]: len(unpaired) + i for i, p in enumerate(middles)}
    names = ("left_shoulder", "left_hip", "nose")
    return np.array([index[name] for name in names] if index.keys() >= set(names) else [], dtype=np.int64)


def _within(block: np.ndarray, links: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the links inside a block and the bits they join."""
    bit = {int(p): j for j, p in enumerate(block)}
    inside = [k for k, (a, b) in enumerate(links) if int(a) in bit and int(b) in bit]
    ends = [[bit[int(links[k, 0])], bit[int(links[k, 1])]] for k in inside]
    return np.array(inside, dtype=np.int64), np.array(ends, dtype=np.int64).reshape(-1, 2)
