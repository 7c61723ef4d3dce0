"""Contact of feet with the ground for the solve over time, with a model of the ground from the whole recording."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posefuse.biomechanics.contact import Contact, ContactModel, fit_contact_model
from posefuse.biomechanics.floor_levels import Levels
from posefuse.biomechanics.foot_paths import (
    HEEL,
    SIDES,
    FootPaths,
    foot_paths_of_points,
    has_feet,
    level_axes,
    part_keypoints,
)
from posefuse.biomechanics.gait import timed_contact
from posefuse.model.cameras import CameraRig
from posefuse.model.reconstruction import Layer, unpack_covariance
from posefuse.skeleton.skeletons import Skeleton
from posefuse.trajectory.ground_contact import GroundContact

_MIN_FRAMES = 8
_MAX_VELOCITY_SD_M_S = 0.18
"""Beyond this spread of the velocity of resting points, nothing shows that feet rest. It is at most 0.16 in simulated
walks with the errors of OpenPose and 0.12 in real recordings, and at least 0.19 where simulated people slide their feet
in every step."""


@dataclass(frozen=True, eq=False)
class FootContact:
    """Estimates the contact of people's feet from their paths.

    Attributes:
        skeleton: of the keypoints; it has feet.
        turn: shape (3, 3): rotation to axes with z up.
        models: ground of each person; None for people without feet in the sample, or whose feet do not rest.
    """

    skeleton: Skeleton
    turn: np.ndarray
    models: tuple[ContactModel | None, ...]

    def __call__(
        self, person: int, time_s: np.ndarray, paths_m: np.ndarray, covariance_m2: np.ndarray
    ) -> GroundContact | None:
        """Return the contact of a person; see :class:`posefuse.trajectory.ground_contact.FindContact`."""
        model = self.models[person]
        if model is None or len(time_s) < _MIN_FRAMES:
            return None
        points, covariance = paths_m.swapaxes(0, 1), covariance_m2.swapaxes(0, 1)
        paths = foot_paths_of_points(time_s, points, covariance, self.skeleton, self.turn)
        contact, _ = timed_contact(paths, model)
        keypoints, touching, resting, heights = [], [], [], []
        for s, side in enumerate(SIDES):
            for part in range(contact.probability.shape[2]):
                own = np.nan_to_num(contact.probability[:, s, part])
                for keypoint in part_keypoints(self.skeleton, side, part):
                    keypoints.append(keypoint)
                    touching.append(own)
                    resting.append(own * (1.0 - contact.sliding[:, s]))
                    heights.append(_resting_height(points[:, keypoint] @ self.turn.T, paths, contact, s, part))
        slope = np.array([*-model.levels.slope, 1.0])
        size = np.linalg.norm(slope)
        return GroundContact(
            keypoints,
            np.stack(touching),
            np.stack(resting),
            np.array([*model.ground_m_s, 0.0]) @ self.turn,
            (slope / size) @ self.turn,
            np.stack(heights) / size,
            model.levels.sd_m,
        )


def find_foot_contact(
    rig: CameraRig, skeleton: Skeleton, solved: Iterable[tuple[np.ndarray, Layer]]
) -> FootContact | None:
    """Return the estimator of contact, or None where contact cannot be estimated: without feet or an up axis.

    Args:
        rig: calibrated cameras.
        skeleton: of the keypoints.
        solved: times and solved layers of ranges of frames, in order of time.
    """
    if rig.up is None or not has_feet(skeleton):
        return None
    turn = level_axes(np.array(rig.up))
    parts = list(solved)
    time_s = np.concatenate([time_s for time_s, _ in parts])
    points = np.concatenate([np.asarray(layer.points_m) for _, layer in parts])
    covariance = unpack_covariance(np.concatenate([np.asarray(layer.covariance_m2) for _, layer in parts]))
    models = []
    for person in range(points.shape[1]):
        paths = foot_paths_of_points(time_s, points[:, person], covariance[:, person], skeleton, turn)
        seen = np.isfinite(paths.feet_m[..., 0]).any(axis=(1, 2))
        model = fit_contact_model(paths) if seen.sum() >= _MIN_FRAMES else None
        models.append(model if model is not None and model.velocity_sd_m_s <= _MAX_VELOCITY_SD_M_S else None)
    return FootContact(skeleton, turn, tuple(models))


def _resting_height(points_m: np.ndarray, paths: FootPaths, contact: Contact, side: int, part: int) -> np.ndarray:
    """Return the height of the level below a keypoint along the vertical, plus its own height at rest.

    Args:
        points_m: shape (frame, 3): the keypoint, in axes with z up.
        paths: paths of the person.
        contact: contact of the person.
        side: index of the foot.
        part: heel or toes.

    Returns:
        Shape (frame,): height above the plane through the origin with the slope of the levels, NaN without levels.
    """
    levels: Levels = contact.model.levels
    if not levels.heights_m.size:
        return np.full(len(points_m), np.nan)
    above = levels.nearest_height(paths.feet_m)[:, side, part]
    own = points_m[:, 2] - points_m[:, :2] @ levels.slope
    # The keypoint of a part differs from the mean of the part by a constant.
    foot = paths.feet_m[:, side, part]
    apart = own - (foot[:, 2] - foot[:, :2] @ levels.slope)
    rests = np.nan_to_num(contact.probability[:, side, part]) > 0.5
    known = rests & np.isfinite(apart)
    constant = float(np.median(apart[known])) if known.any() and part != HEEL else 0.0
    return own - apart - above + constant
