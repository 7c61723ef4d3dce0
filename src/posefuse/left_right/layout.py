"""Which pairs are decided together: limbs, the bones between them, and the points of the body's midline."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from posefuse.skeleton.skeletons import Skeleton

_BLOCK = 6
_UNPAIRED = 8
_MIDPOINTS = 12


@dataclass(frozen=True, eq=False)
class Layout:
    """A skeleton as the decision on sides sees it.

    Attributes:
        chains: names; a pair in no chain is a chain of its own.
        chain_of: shape (pair,), int64.
        blocks: pairs that are decided jointly, shape (J,), int64, J at most 6: a chain, or a stretch of a long one.
        links: shape (link, 2), int64: pairs that bones join, on each side alike.
        within: of each block, the links it holds, shape (K,), and the bits they join, shape (K, 2).
        across: shape (A,), int64: links that join two blocks.
        unpaired: shape (U,), int64: keypoints without a partner.
        middles: shape (M,), int64: pairs whose midpoints, after the unpaired keypoints, show the body's midline.
        trunk: shape (pair,), bool: pairs where limbs join the trunk, whose vectors point the same way at rest.
        facing: shape (3,), int64: shoulders, hips and nose among the points of the midline; empty where one is not
            there. Seen from the shoulders, hips cross nose points to the right.
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
        """From the skeleton's pairs, chains and edges."""
        names, members = _chains(skeleton)
        chain_of = np.zeros(len(skeleton.pairs), dtype=np.int64)
        for c, chain in enumerate(members):
            chain_of[chain] = c
        blocks = tuple(
            np.array(chain[i : i + _BLOCK], dtype=np.int64) for chain in members for i in range(0, len(chain), _BLOCK)
        )
        links = _links(skeleton, members)
        block_of = np.zeros(len(skeleton.pairs), dtype=np.int64)
        for b, block in enumerate(blocks):
            block_of[block] = b
        across = np.flatnonzero(block_of[links[:, 0]] != block_of[links[:, 1]])
        within = tuple(_within(block, links) for block in blocks)
        unpaired = np.flatnonzero(skeleton.mirror == np.arange(len(skeleton)))[:_UNPAIRED]
        # From the trunk outwards, a ring of all chains at a time.
        ranked = sorted((rank, p) for chain in members for rank, p in enumerate(chain))
        middles = np.array([p for _, p in ranked[:_MIDPOINTS]], dtype=np.int64)
        trunk = np.zeros(len(skeleton.pairs), dtype=bool)
        trunk[_roots(members)] = True
        facing = _facing(skeleton, unpaired, middles)
        return cls(names, chain_of, blocks, links, within, across, unpaired, middles, trunk, facing)


def _chains(skeleton: Skeleton) -> tuple[tuple[str, ...], list[list[int]]]:
    """Names of the chains and their pairs from the trunk outwards, then every other pair by itself."""
    place = {pair: p for p, pair in enumerate(skeleton.pairs)}
    taken: set[int] = set()
    names: list[str] = []
    members: list[list[int]] = []
    for name, chain in skeleton.chains.items():
        pairs = [place[pair] for pair in chain if pair in place and place[pair] not in taken]
        if pairs:
            taken.update(pairs)
            names.append(name)
            members.append(pairs)
    for (left, _), p in place.items():
        if p not in taken:
            names.append(left.removeprefix("left_"))
            members.append([p])
    return tuple(names), members


def _links(skeleton: Skeleton, members: list[list[int]]) -> np.ndarray:
    """Neighbours in a chain, pairs that an edge joins on one side, and the trunk: the roots of all chains."""
    place = {name: (p, side) for p, pair in enumerate(skeleton.pairs) for side, name in enumerate(pair)}
    found = {tuple(sorted(two)) for chain in members for two in pairwise(chain)}
    for a, b in skeleton.edges:
        if a in place and b in place and place[a][1] == place[b][1] and place[a][0] != place[b][0]:
            found.add(tuple(sorted((place[a][0], place[b][0]))))
    limbs = _roots(members)
    for i, root in enumerate(limbs):
        found.update(tuple(sorted((root, other))) for other in limbs[:i])
    for chain in members:
        if len(chain) == 1 and chain[0] not in limbs:
            found.update(tuple(sorted((chain[0], root))) for root in limbs)
    return np.array(sorted(found), dtype=np.int64).reshape(-1, 2)


def _roots(members: list[list[int]]) -> list[int]:
    """The first pairs of limbs, or of a skeleton without limbs its first pairs."""
    return [chain[0] for chain in members if len(chain) > 1][:4] or [chain[0] for chain in members][:3]


def _facing(skeleton: Skeleton, unpaired: np.ndarray, middles: np.ndarray) -> np.ndarray:
    place = {skeleton.keypoints[k]: i for i, k in enumerate(unpaired)}
    place |= {skeleton.pairs[p][0]: len(unpaired) + i for i, p in enumerate(middles)}
    names = ("left_shoulder", "left_hip", "nose")
    return np.array([place[name] for name in names] if place.keys() >= set(names) else [], dtype=np.int64)


def _within(block: np.ndarray, links: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    bit = {int(p): j for j, p in enumerate(block)}
    inside = [k for k, (a, b) in enumerate(links) if int(a) in bit and int(b) in bit]
    ends = [[bit[int(links[k, 0])], bit[int(links[k, 1])]] for k in inside]
    return np.array(inside, dtype=np.int64), np.array(ends, dtype=np.int64).reshape(-1, 2)
