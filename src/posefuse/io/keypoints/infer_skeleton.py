"""Inference of the skeleton from the number and layout of keypoints, for files that do not name it."""

from pathlib import Path

import numpy as np

from posefuse.errors import FileError, SkeletonError, choices
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton, shipped_skeletons

# The bones of the correct skeleton are short relative to the person; those of a wrong one cross the body. Measured on
# OpenPose BODY_25B data: 0.11 of the person's extent when read as BODY_25B, 0.32 when read as BODY_25.
_MAX_RATIO = 0.8
_MAX_PEOPLE = 500


def infer_skeleton(n_keypoints: int, keypoints_px: np.ndarray, source: str) -> tuple[Skeleton, tuple[str, ...]]:
    """Return the shipped skeleton with this number of keypoints; of several, the one with the shortest bones.

    Args:
        n_keypoints: Number of keypoints per person.
        keypoints_px: Shape (row, n_keypoints, 2): detected people.
        source: Origin of the keypoints, for messages.

    Returns:
        The skeleton, and notes about the choice.

    Raises:
        SkeletonError: If no shipped skeleton has this number of keypoints, or several do and the bone lengths do not
            decide between them.
    """
    candidates = [shipped_skeleton(name) for name in shipped_skeletons()]
    # Laboratories define the keypoints of animals themselves, so their number does not identify the skeleton.
    fitting = [s for s in candidates if len(s) == n_keypoints and (s.tree is None or s.tree.scale == 1.0)]
    if not fitting:
        shipped = choices((f"{s.name} ({len(s)})" for s in candidates), 20)
        raise SkeletonError(
            f"{source} has {n_keypoints} keypoints, but no shipped skeleton does: {shipped}. "
            "Specify `skeleton` with the name of a skeleton or the path of its TOML file."
        )
    if len(fitting) == 1:
        return fitting[0], ()
    ratios = sorted((relative_bone_length(skeleton, keypoints_px), skeleton.name) for skeleton in fitting)
    names = [skeleton.name for skeleton in fitting]
    (best, best_name), (second, _) = ratios[0], ratios[1]
    if not best < _MAX_RATIO * second:
        raise SkeletonError(
            f"{source} has {n_keypoints} keypoints, which may be {choices(names)}, and the detections do not determine "
            f"which. Choose one, such as `skeleton={names[0]!r}`."
        )
    note = (
        f"{n_keypoints} keypoints read as {best_name}, whose bones are shortest, not as "
        f"{choices(name for name in names if name != best_name)}. Override with `skeleton`."
    )
    return shipped_skeleton(best_name), (note,)


def no_skeleton(path: Path) -> FileError:
    """Return the error for a recording without people whose skeleton is unknown."""
    return FileError(f"{path}: no person was detected in any view, so the skeleton is unknown. Add `skeleton`.")


def wrong_skeleton(path: Path, n_keypoints: int, skeleton: Skeleton) -> FileError:
    """Return the error for people whose number of keypoints differs from the skeleton's."""
    return FileError(
        f"{path} has {n_keypoints} keypoints per person, but skeleton {skeleton.name} has {len(skeleton)}. Choose "
        "another with `skeleton`, or omit it to infer the skeleton from the files."
    )


def relative_bone_length(skeleton: Skeleton, keypoints_px: np.ndarray) -> float:
    """Return the median over people of the mean bone length divided by the person's extent; inf without people."""
    points = np.asarray(keypoints_px)[:_MAX_PEOPLE]
    detected = np.isfinite(points).all(axis=-1)
    points = points[detected.sum(axis=1) >= 0.5 * points.shape[1]]
    if not len(points):
        return float("inf")
    # Clip implausible coordinates, which would overflow.
    points = np.clip(points, -1e100, 1e100)
    edges = skeleton.edge_indices
    lengths = np.linalg.norm(points[:, edges[:, 0]] - points[:, edges[:, 1]], axis=-1)
    extent = np.linalg.norm(np.nanmax(points, axis=1) - np.nanmin(points, axis=1), axis=-1)
    finite = np.isfinite(lengths)
    mean = np.where(finite, lengths, 0.0).sum(axis=1) / np.maximum(finite.sum(axis=1), 1)
    return float(np.median(mean / np.maximum(extent, 1e-9)))
