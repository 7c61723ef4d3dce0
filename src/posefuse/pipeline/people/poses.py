"""Collect the states of bodies in arrays, person by person and part by part."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from posefuse.kinematics.joint_angles import skeleton_angle_names
from posefuse.skeleton.skeletons import Skeleton
from posefuse.tracking.smoothing import SmoothedPerson


class DerivedStates(NamedTuple):
    """Quantities derived from the states of a body or part.

    Attributes:
        directions: shape (frame, bone, 3): unit vectors along the bones.
        angle_sd_deg: shape (frame, angle): standard deviations of joint angles, in degrees.
    """

    directions: np.ndarray
    angle_sd_deg: np.ndarray


class Offsets(NamedTuple):
    """Index of the first segment, bone and angle of a body or part among all."""

    segment: int
    bone: int
    angle: int


@dataclass(frozen=True, eq=False)
class BodyArrays:
    """States of all people in a range of frames, filled body by body and then part by part.

    Attributes:
        points_m: shape (frame, person, keypoint, 3).
        covariance_m2: shape (frame, person, keypoint, 6).
        used: shape (frame, person, view, keypoint), bool.
        turns: shape (frame, person, segment, 3, 3).
        directions: shape (frame, person, bone, 3).
        angle_sd_deg: shape (frame, person, angle).
        root_turn_rad2: shape (frame, person, 6): covariance of a small turn of the root about its own axes.
        holds_deg2: shape (frame, person, part, 3, 3): covariance of the axes to which parts are attached, in deg^2.
    """

    points_m: np.ndarray
    covariance_m2: np.ndarray
    used: np.ndarray
    turns: np.ndarray
    directions: np.ndarray
    angle_sd_deg: np.ndarray
    root_turn_rad2: np.ndarray
    holds_deg2: np.ndarray

    @classmethod
    def empty(cls, shape: tuple[int, int], views: int, skeleton: Skeleton) -> "BodyArrays":
        """Return arrays without any body, for (frame, person) of a shape."""
        segments, bones, _ = skeleton.body_names
        keypoints = len(skeleton)
        return cls(
            np.full((*shape, keypoints, 3), np.nan),
            np.full((*shape, keypoints, 6), np.nan),
            np.zeros((*shape, views, keypoints), dtype=bool),
            np.full((*shape, len(segments), 3, 3), np.nan),
            np.full((*shape, len(bones), 3), np.nan),
            np.full((*shape, len(skeleton_angle_names(skeleton))), np.nan),
            np.full((*shape, 6), np.nan),
            np.full((*shape, len(skeleton.parts), 3, 3), np.nan),
        )

    def add(
        self,
        person: SmoothedPerson,
        cells: tuple[np.ndarray, np.ndarray],
        seen: np.ndarray,
        keypoints: np.ndarray,
        first: Offsets,
        states: DerivedStates,
    ) -> None:
        """Add the body of a person, or a part of it.

        Args:
            person: smoothed person.
            cells: frame and person indices.
            seen: indices of these frames among the person's frames.
            keypoints: shape (point,): indices of the keypoints.
            first: indices of its first segment, bone and angle.
            states: bones and angles in those frames.
        """
        body, (f, p) = person.body, cells
        self.points_m[f[:, None], p[:, None], keypoints] = body.points_m[seen]
        self.covariance_m2[f[:, None], p[:, None], keypoints] = body.covariance_m2[seen]
        self.turns[f, p, first.segment : first.segment + body.turns.shape[1]] = body.turns[seen]
        self.directions[f, p, first.bone : first.bone + states.directions.shape[1]] = states.directions
        self.angle_sd_deg[f, p, first.angle : first.angle + states.angle_sd_deg.shape[1]] = states.angle_sd_deg
