"""Skeletons from keypoint names alone."""

import re
from collections.abc import Sequence

from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton, shipped_skeletons


def skeleton_of(name: str, keypoints: Sequence[str], edges: Sequence[tuple[str, str]] = ()) -> Skeleton:
    """Return a skeleton with the keypoint names of a file. Left and right pairs are inferred from the names."""
    lower = {keypoint.lower(): keypoint for keypoint in keypoints}
    pairs = []
    for keypoint in keypoints:
        partner = _other_side(keypoint.lower())
        if partner in lower:
            pairs.append((keypoint, lower[partner]))
    return Skeleton(name, tuple(keypoints), edges=tuple(edges), pairs=tuple(pairs))


def skeleton_named(name: str, keypoints: Sequence[str]) -> Skeleton:
    """Return the shipped skeleton with exactly these keypoints in this order, or a new one if there is none."""
    for shipped in map(shipped_skeleton, shipped_skeletons()):
        if shipped.keypoints == tuple(keypoints):
            return shipped
    return skeleton_of(name, keypoints)


def _other_side(name: str) -> str | None:
    """Return the lower-case name of the right counterpart of a left keypoint, or None for other keypoints."""
    for pattern, other in ((r"(^|_)left(_|$)", r"\1right\2"), (r"(^|_)l(_|$)", r"\1r\2")):
        if re.search(pattern, name):
            return re.sub(pattern, other, name)
    return None
