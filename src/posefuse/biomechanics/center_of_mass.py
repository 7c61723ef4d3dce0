"""The centre of mass of a body, from its segments' shares of the mass."""

from dataclasses import dataclass

import numpy as np

from posefuse.model.reconstruction import Layer
from posefuse.model.status import Source
from posefuse.skeleton.masses import Masses, MassSegment
from posefuse.skeleton.skeletons import Skeleton

LEAST_SHARE = 0.9
"""With less of the mass known there is no centre."""


@dataclass(frozen=True, eq=False)
class Centres:
    """Centres of mass of everybody.

    Attributes:
        xyz_m: shape (frame, person, 3), NaN where too little is known.
        known_share: shape (frame, person): of the mass, whose segments have points.
        filled_share: shape (frame, person): of the mass, whose segments rest on points that were filled.
    """

    xyz_m: np.ndarray
    known_share: np.ndarray
    filled_share: np.ndarray


def centres_of_mass(layer: Layer, skeleton: Skeleton, masses: Masses) -> Centres:
    """Where everybody's centre of mass is, by those segments that are known; it stands for the rest of them too.

    Args:
        layer: of consecutive frames.
        skeleton: of its keypoints.
        masses: of a body's segments.

    Raises:
        SkeletonError: if the skeleton lacks a segment.
    """
    masses.check(skeleton)
    points, filled = np.asarray(layer.points_m[:]), np.asarray(layer.source[:]) == Source.FILLED
    total = np.zeros((*points.shape[:2], 3))
    known, guessed = np.zeros(points.shape[:2]), np.zeros(points.shape[:2])
    for segment in masses.segments:
        centre, of_filled = _centre(points, filled, skeleton, segment)
        there = np.isfinite(centre[..., 0])
        total += np.where(there[..., None], segment.mass * centre, 0.0)
        known += segment.mass * there
        guessed += segment.mass * (there & of_filled)
    share = known / sum(segment.mass for segment in masses.segments)
    enough = share >= LEAST_SHARE
    with np.errstate(divide="ignore", invalid="ignore"):
        xyz = np.where(enough[..., None], total / known[..., None], np.nan)
    return Centres(xyz, share, guessed / sum(segment.mass for segment in masses.segments))


def _centre(
    points_m: np.ndarray, filled: np.ndarray, skeleton: Skeleton, segment: MassSegment
) -> tuple[np.ndarray, np.ndarray]:
    """Shape (frame, person, 3), and shape (frame, person), bool: whether it rests on a filled point."""
    ends = segment.ends_in(skeleton)
    assert ends is not None
    near, far = ([skeleton.index(name) for name in names] for names in ends[:2])
    start, end = points_m[:, :, near].mean(axis=2), points_m[:, :, far].mean(axis=2)
    return start + ends[2] * (end - start), np.asarray(filled[:, :, near + far].any(axis=2))
