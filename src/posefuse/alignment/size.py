"""How large the world is: from the subject's height, or from one known distance."""

from collections.abc import Sequence

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.model.options.alignment import AlignOptions
from posefuse.skeleton.skeletons import Skeleton

_SHARES = (
    ("shoulder", "hip", 0.288),
    ("hip", "knee", 0.245),
    ("knee", "ankle", 0.246),
    ("shoulder", "elbow", 0.186),
    ("elbow", "wrist", 0.146),
)
"""Distances between joints as shares of the height. Source: Drillis & Contini 1966, in Winter 2009, figure 4.1."""

_FEWEST = 10


def scale_of(points_m: Sequence[np.ndarray], skeleton: Skeleton, options: AlignOptions) -> float:
    """What lengths must be multiplied by for the subject, or the distance, to be as large as the options say.

    Args:
        points_m: arrays of shape (frame, person, keypoint, 3); of several people all count alike.
        skeleton: of the keypoints.
        options: with a height or a length.

    Raises:
        DetectionsError: if what is known was not seen.
        SkeletonError: if a keypoint is not there.
    """
    if options.length_m is not None:
        first, second = options.length_between
        found = median_distance(points_m, skeleton, first, second)
        if found is None:
            raise DetectionsError(f"align.length_m: {first} and {second} are hardly ever seen together.")
        return options.length_m / found
    assert options.height_m is not None
    return options.height_m / height_of(points_m, skeleton)


def height_of(points_m: Sequence[np.ndarray], skeleton: Skeleton) -> float:
    """The height of a human, from the distances between joints, which do not depend on how they stand.

    Args:
        points_m: arrays of shape (frame, person, keypoint, 3).
        skeleton: of a human.

    Raises:
        DetectionsError: if no such distance was seen.
    """
    lengths, shares = [], []
    for near, far, share in _SHARES:
        for side in ("left", "right"):
            names = f"{side}_{near}", f"{side}_{far}"
            if all(name in skeleton.keypoints for name in names):
                found = median_distance(points_m, skeleton, *names)
                if found is not None:
                    lengths.append(found)
                    shares.append(share)
    if not lengths:
        raise DetectionsError(
            f"align.height_m needs limbs of a human (shoulder, elbow, wrist, hip, knee, ankle), and none was seen of "
            f"skeleton {skeleton.name}. Give a known distance instead (align.length_m, align.length_between)."
        )
    return sum(lengths) / sum(shares)


def median_distance(points_m: Sequence[np.ndarray], skeleton: Skeleton, first: str, second: str) -> float | None:
    """The median distance of two keypoints, or None if they are hardly ever seen together."""
    i, j = skeleton.index(first), skeleton.index(second)
    found = np.concatenate([np.linalg.norm(part[..., i, :] - part[..., j, :], axis=-1).ravel() for part in points_m])
    found = found[np.isfinite(found)]
    return float(np.median(found)) if len(found) >= _FEWEST else None
