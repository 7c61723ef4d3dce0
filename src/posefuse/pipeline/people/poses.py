"""Where bodies stood, gathered person by person and part by part."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from posefuse.kinematics.joint_angles import skeleton_angle_names
from posefuse.skeleton.skeletons import Skeleton
from posefuse.tracking.smoothing import SmoothedPerson


class Known(NamedTuple):
    """Of somebody's body or part: directions, shape (frame, bone, 3), and sds of angles, (frame, angle), degrees."""

    directions: np.ndarray
    angle_sd_deg: np.ndarray


class Places(NamedTuple):
    """Where the segments, bones and angles of a body or a part begin among all."""

    segment: int
    bone: int
    angle: int


@dataclass(frozen=True, eq=False)
class Stood:
    """Where people are in a range of frames, to be filled; bodies first, then their parts.

    Attributes:
        points_m: shape (frame, person, keypoint, 3).
        covariance_m2: shape (frame, person, keypoint, 6).
        used: shape (frame, person, view, keypoint), bool.
        bridged: shape (frame, person, keypoint), bool: nothing supported what it belongs to.
        turns: shape (frame, person, segment, 3, 3).
        directions: shape (frame, person, bone, 3).
        angle_sd_deg: shape (frame, person, angle).
        holds_deg2: shape (frame, person, part, 3, 3): how well the axes in which bodies have their parts are known.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    used: np.ndarray
    bridged: np.ndarray
    turns: np.ndarray
    directions: np.ndarray
    angle_sd_deg: np.ndarray
    holds_deg2: np.ndarray

    @classmethod
    def room(cls, shape: tuple[int, int], views: int, skeleton: Skeleton) -> "Stood":
        """Nobody anywhere, in so many frames and of so many people."""
        segments, bones, _ = skeleton.body_names
        keypoints = len(skeleton)
        return cls(
            np.full((*shape, keypoints, 3), np.nan),
            np.full((*shape, keypoints, 6), np.nan),
            np.zeros((*shape, views, keypoints), dtype=bool),
            np.zeros((*shape, keypoints), dtype=bool),
            np.full((*shape, len(segments), 3, 3), np.nan),
            np.full((*shape, len(bones), 3), np.nan),
            np.full((*shape, len(skeleton_angle_names(skeleton))), np.nan),
            np.full((*shape, len(skeleton.parts), 3, 3), np.nan),
        )

    def put(
        self,
        person: SmoothedPerson,
        cells: tuple[np.ndarray, np.ndarray],
        seen: np.ndarray,
        keypoints: np.ndarray,
        first: Places,
        known: Known,
    ) -> None:
        """Somebody's body, or a part of it.

        Args:
            person: as smoothed.
            cells: frames and people.
            seen: which of the person's frames these are.
            keypoints: shape (point,): places of the keypoints.
            first: places of its first segment, bone and angle.
            known: of its bones and angles in those frames.
        """
        body, (f, p) = person.body, cells
        self.points_m[f[:, None], p[:, None], keypoints] = body.points_m[seen]
        self.covariance_m2[f[:, None], p[:, None], keypoints] = body.covariance_m2[seen]
        self.bridged[f[:, None], p[:, None], keypoints] = (person.missing_s[seen] > 0.0)[:, None]
        self.turns[f, p, first.segment : first.segment + body.turns.shape[1]] = body.turns[seen]
        self.directions[f, p, first.bone : first.bone + known.directions.shape[1]] = known.directions
        self.angle_sd_deg[f, p, first.angle : first.angle + known.angle_sd_deg.shape[1]] = known.angle_sd_deg
