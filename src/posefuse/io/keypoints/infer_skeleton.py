"""Which skeleton so many keypoints are, where files do not say."""

import numpy as np

from posefuse.errors import SkeletonError, choices
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton, shipped_skeletons

# The right skeleton's bones are short against the person; a wrong one's run across the body. Measured on OpenPose
# BODY_25B data: 0.11 of the person's extent when read as it is, 0.32 when read as BODY_25.
_CLEAR = 0.8


def guess_skeleton(n_keypoints: int, keypoints_px: np.ndarray, source: str) -> tuple[Skeleton, tuple[str, ...]]:
    """The skeleton of so many keypoints; among several, the one whose bones hold together on the people seen.

    Args:
        n_keypoints: how many keypoints each person has.
        keypoints_px: shape (row, n_keypoints, 2): people to judge by.
        source: where they come from, for messages.

    Returns:
        The skeleton, and what is worth saying about the choice.

    Raises:
        SkeletonError: if no shipped skeleton has so many keypoints, or several do and the people do not tell.
    """
    candidates = [shipped_skeleton(name) for name in shipped_skeletons()]
    # Laboratories number an animal's keypoints as they like: how many there are says too little.
    fitting = [s for s in candidates if len(s) == n_keypoints and (s.tree is None or s.tree.scale == 1.0)]
    if not fitting:
        known = choices((f"{s.name} ({len(s)})" for s in candidates), 20)
        raise SkeletonError(
            f"{source} has {n_keypoints} keypoints, and no shipped skeleton has: {known}. "
            "Say what they are: --skeleton takes a name or the path of a skeleton's TOML file."
        )
    if len(fitting) == 1:
        return fitting[0], ()
    spread = sorted((mean_bone_share(skeleton, keypoints_px), skeleton.name) for skeleton in fitting)
    names = [skeleton.name for skeleton in fitting]
    (best, best_name), (second, _) = spread[0], spread[1]
    if not best < _CLEAR * second:
        raise SkeletonError(
            f"{source} has {n_keypoints} keypoints, which may be {choices(names)}, and the people seen do not tell. "
            f"Say which: --skeleton {names[0]}."
        )
    note = (
        f"{n_keypoints} keypoints read as {best_name}, whose bones hold together, not as "
        f"{choices(name for name in names if name != best_name)}. --skeleton says otherwise."
    )
    return shipped_skeleton(best_name), (note,)


def mean_bone_share(skeleton: Skeleton, keypoints_px: np.ndarray) -> float:
    """Median over people of the mean bone length as a share of the person's extent; inf without people."""
    points = np.asarray(keypoints_px)[:500]
    seen = np.isfinite(points).all(axis=-1)
    points = points[seen.sum(axis=1) >= 0.5 * points.shape[1]]
    if not len(points):
        return float("inf")
    # Coordinates beyond all reason are as far apart as can be, and tell nothing.
    points = np.clip(points, -1e100, 1e100)
    edges = skeleton.edge_indices
    lengths = np.linalg.norm(points[:, edges[:, 0]] - points[:, edges[:, 1]], axis=-1)
    extent = np.linalg.norm(np.nanmax(points, axis=1) - np.nanmin(points, axis=1), axis=-1)
    known = np.isfinite(lengths)
    mean = np.where(known, lengths, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    return float(np.median(mean / np.maximum(extent, 1e-9)))
