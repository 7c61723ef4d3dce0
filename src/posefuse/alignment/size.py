"""Determine the scale of the world from the subject's height or from one known distance."""

from collections.abc import Sequence

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.model.options.alignment import AlignOptions
from posefuse.skeleton.skeletons import Skeleton

_HEIGHT_SHARES = (
    ("shoulder", "hip", 0.288),
    ("hip", "knee", 0.245),
    ("knee", "ankle", 0.246),
    ("shoulder", "elbow", 0.186),
    ("elbow", "wrist", 0.146),
)
"""Distances between joints as shares of the height. Source: Drillis and Contini 1966, in Winter 2009, figure 4.1."""

_MIN_FRAMES = 10


def scale_factor(points_m: Sequence[np.ndarray], skeleton: Skeleton, options: AlignOptions) -> float:
    """Return the factor that gives the subject, or the distance, the size set in the options.

    Args:
        points_m: arrays of shape (frame, person, keypoint, 3); all people count equally.
        skeleton: of the keypoints.
        options: with a height or a length.

    Raises:
        DetectionsError: if the reference was not observed.
        SkeletonError: if a keypoint does not exist.
    """
    if options.length_m is not None:
        first, second = options.length_between
        distance_m = median_distance(points_m, skeleton, first, second)
        if distance_m is None:
            raise DetectionsError(
                f"align.length_m: {first} and {second} are rarely observed together. Set other keypoints in "
                "align.length_between."
            )
        return options.length_m / distance_m
    assert options.height_m is not None
    return options.height_m / estimate_height_m(points_m, skeleton)


def estimate_height_m(points_m: Sequence[np.ndarray], skeleton: Skeleton) -> float:
    """Estimate the height of a human from distances between joints, which do not depend on posture.

    Args:
        points_m: arrays of shape (frame, person, keypoint, 3).
        skeleton: of a human.

    Raises:
        DetectionsError: if no such distance was observed.
    """
    lengths, shares = [], []
    for near, far, share in _HEIGHT_SHARES:
        for side in ("left", "right"):
            names = f"{side}_{near}", f"{side}_{far}"
            if all(name in skeleton.keypoints for name in names):
                distance_m = median_distance(points_m, skeleton, *names)
                if distance_m is not None:
                    lengths.append(distance_m)
                    shares.append(share)
    if not lengths:
        raise DetectionsError(
            "align.height_m needs human limbs (shoulder, elbow, wrist, hip, knee, ankle), but none were observed for "
            f"skeleton {skeleton.name}. Set a known distance instead (align.length_m, align.length_between)."
        )
    return sum(lengths) / sum(shares)


def median_distance(points_m: Sequence[np.ndarray], skeleton: Skeleton, first: str, second: str) -> float | None:
    """Return the median distance of two keypoints in m, or None if they are rarely observed together."""
    i, j = skeleton.index(first), skeleton.index(second)
    distance_m = np.concatenate(
        [np.linalg.norm(part[..., i, :] - part[..., j, :], axis=-1).ravel() for part in points_m]
    )
    distance_m = distance_m[np.isfinite(distance_m)]
    return float(np.median(distance_m)) if len(distance_m) >= _MIN_FRAMES else None
