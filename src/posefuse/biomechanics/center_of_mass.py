"""Estimate the center of mass of each person from segment masses."""

from dataclasses import dataclass

import numpy as np

from posefuse.model.reconstruction import Layer
from posefuse.model.status import Source
from posefuse.skeleton.masses import Masses, MassSegment
from posefuse.skeleton.skeletons import Skeleton

MIN_KNOWN_SHARE = 0.9
"""Minimum share of the mass in visible segments; with less, the center of mass is missing."""


@dataclass(frozen=True, eq=False)
class CentersOfMass:
    """Hold the centers of mass of all people.

    Attributes:
        xyz_m: shape (frame, person, 3), NaN where too little of the body is known.
        known_share: shape (frame, person): share of the mass in segments with points.
        filled_share: shape (frame, person): share of the mass in segments that use filled points.
    """

    xyz_m: np.ndarray
    known_share: np.ndarray
    filled_share: np.ndarray


def centers_of_mass(layer: Layer, skeleton: Skeleton, masses: Masses) -> CentersOfMass:
    """Estimate the center of mass of every person; known segments also represent the missing ones.

    Args:
        layer: of consecutive frames.
        skeleton: of its keypoints.
        masses: segment masses.

    Raises:
        SkeletonError: if the skeleton lacks a segment.
    """
    masses.check(skeleton)
    points, filled = np.asarray(layer.points_m[:]), np.asarray(layer.source[:]) == Source.FILLED
    total = np.zeros((*points.shape[:2], 3))
    known, filled_mass = np.zeros(points.shape[:2]), np.zeros(points.shape[:2])
    for segment in masses.segments:
        center, uses_filled = _segment_center(points, filled, skeleton, segment)
        is_known = np.isfinite(center[..., 0])
        total += np.where(is_known[..., None], segment.mass * center, 0.0)
        known += segment.mass * is_known
        filled_mass += segment.mass * (is_known & uses_filled)
    share = known / sum(segment.mass for segment in masses.segments)
    enough = share >= MIN_KNOWN_SHARE
    with np.errstate(divide="ignore", invalid="ignore"):
        xyz = np.where(enough[..., None], total / known[..., None], np.nan)
    return CentersOfMass(xyz, share, filled_mass / sum(segment.mass for segment in masses.segments))


def _segment_center(
    points_m: np.ndarray, filled: np.ndarray, skeleton: Skeleton, segment: MassSegment
) -> tuple[np.ndarray, np.ndarray]:
    """Return the center of a segment, shape (frame, person, 3).

    The second array, shape (frame, person), states whether it uses a filled point.
    """
    ends = segment.ends_in(skeleton)
    assert ends is not None
    near, far = ([skeleton.index(name) for name in names] for names in ends[:2])
    start, end = points_m[:, :, near].mean(axis=2), points_m[:, :, far].mean(axis=2)
    return start + ends[2] * (end - start), np.asarray(filled[:, :, near + far].any(axis=2))
