"""Infer the up direction from upright people: their shoulders are above their hips, and their hips above their feet.

The body alone does not show it, since a person who lies is as straight as one who stands. So a direction counts only if
the cameras or the feet confirm it: most cameras are level, so that up is up in their images, and they look at a person
who stands from the sides; or the feet stand still while the shoulders above them move. All rules are relative to each
other, so the result turns with the world. Without sufficient evidence there is no result.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.up_axis import InferredUp
from posefuse.skeleton.skeletons import Skeleton

_JOINTS = ("shoulder", "hip", "ankle")
_MAX_BEND_DEG = 45.0
"""Largest angle between trunk and legs of a person who stands; it is 90 degrees sitting."""

_MIN_STANDING = 10
_MIN_STANDING_SHARE = 0.5
"""Least number of times a standing person is seen, and least share of those in which shoulders, hips and ankles are."""

_MAX_SPREAD_DEG = 20.0
"""Largest median angle between a body and the common direction."""

_MAX_ITERATIONS = 50
_LEVEL_DEG = 45.0
"""A camera agrees with a direction closer than this to up in its image: it is level but for looking down or up."""

_LEVEL_SHARE, _LEVEL_SHARE_WITH_FEET = 0.75, 0.5
"""Shares of the cameras that must agree, without and with the evidence of the feet."""

_MIN_AZIMUTH_DEG = 60.0
"""Cameras on one side look the same at people who stand and, from above, at people who lie."""

_STEP_S, _STEP_FRAMES = 0.3, 9
"""Time over which movements are compared, and the number of frames where the rate is unknown."""

_MIN_STEP_M, _MAX_FOOT_SHARE = 0.03, 0.5
"""Shoulders move by more than the first, and the stiller foot by less than the second times as much."""

_MIN_STEPS, _MIN_STEP_SHARE = 10, 0.75
"""Least number of such movements, and least share among those of shoulders."""

_POSTURE_SD_DEG = 8.0
"""Standard deviation of people's mean posture: they lean forward. Errors are 2 to 11 degrees in real recordings."""


@dataclass(frozen=True, eq=False)
class _Bodies:
    """Mid shoulders, mid hips and the two ankles of all people, shape (frame, person, 3) each."""

    shoulders: np.ndarray
    hips: np.ndarray
    ankles: tuple[np.ndarray, np.ndarray]


def infer_up(
    points_m: Sequence[np.ndarray], skeleton: Skeleton, rig: CameraRig, rate_hz: float | None
) -> tuple[InferredUp | None, str]:
    """Return the up direction in which people stand, and the evidence in words.

    Args:
        points_m: ranges of consecutive frames in the rig's world, each of shape (frame, person, keypoint, 3).
        skeleton: of the keypoints; only a human one, with shoulders, hips and ankles, defines what is up.
        rig: the cameras.
        rate_hz: frame rate, if known.

    Returns:
        The direction, or None without sufficient evidence; and a clause that states the evidence, or what is missing.
    """
    names = [f"{side}_{joint}" for joint in _JOINTS for side in ("left", "right")]
    if not skeleton.plausible_m or not set(names) <= set(skeleton.keypoints):
        return None, "the skeleton does not define which keypoints are above others"
    parts = [_bodies(part, [skeleton.index(name) for name in names]) for part in points_m]
    along, share = _standing_directions(parts)
    if len(along) < _MIN_STANDING or share < _MIN_STANDING_SHARE:
        return None, "too few people stand upright"
    up = _common_direction(along)
    spread_deg = float(np.median(_angles_deg(along, up)))
    if spread_deg > _MAX_SPREAD_DEG:
        return None, f"people's bodies point in different directions, {spread_deg:.0f} degrees apart"
    steps = max(1, _STEP_FRAMES if not rate_hz else round(_STEP_S * rate_hz))
    evidence = _evidence(rig, up, _feet_support(parts, steps))
    if evidence is None:
        return None, "neither the cameras nor the feet show whether people stand or lie"
    n_people = max(sum(part.shape[1] for part in points_m[:1]), 1)
    sd_deg = float(np.hypot(_POSTURE_SD_DEG, spread_deg / np.sqrt(n_people)))
    return InferredUp(tuple(up.tolist()), sd_deg), evidence


def describe_up(up: InferredUp | None, reason: str) -> str:
    """Return a sentence on the outcome of :func:`infer_up`."""
    if up is None:
        return f"The up axis is unknown, so exports are not rotated: {reason}. Set it with `up`."
    where = f"{up.angle_deg:.0f} degrees from {up.nearest_axis}, with a standard deviation of {up.sd_deg:.0f} degrees"
    if up.axis is None:
        return (
            f"Up is inferred from people: {reason}. It is {where}, too far from an axis, so exports are not rotated. "
            "`align.floor='feet'`, or another option of align such as `align.preset='opensim'`, levels the world."
        )
    return (
        f"Up is inferred from people as {up.axis}: {reason}. It is {where}. Set it with `up`, or level the world with "
        "`align.floor='feet'`."
    )


def _bodies(points_m: np.ndarray, columns: list[int]) -> _Bodies:
    left, right = points_m[:, :, columns[::2]], points_m[:, :, columns[1::2]]
    middle = 0.5 * (left + right)
    return _Bodies(middle[:, :, 0], middle[:, :, 1], (left[:, :, 2], right[:, :, 2]))


def _standing_directions(parts: Sequence[_Bodies]) -> tuple[np.ndarray, float]:
    """Return the directions from feet to shoulders of people who stand, shape (body, 3), and their share of bodies."""
    shoulders = np.concatenate([part.shoulders.reshape(-1, 3) for part in parts])
    hips = np.concatenate([part.hips.reshape(-1, 3) for part in parts])
    feet = np.concatenate([(0.5 * (part.ankles[0] + part.ankles[1])).reshape(-1, 3) for part in parts])
    known = np.isfinite(shoulders + hips + feet).all(axis=-1)
    trunk, legs, body = (
        _unit(upper[known] - lower[known]) for upper, lower in ((shoulders, hips), (hips, feet), (shoulders, feet))
    )
    straight = np.einsum("ni,ni->n", trunk, legs) > np.cos(np.radians(_MAX_BEND_DEG))
    return body[straight], float(straight.mean()) if len(straight) else 0.0


def _common_direction(along: np.ndarray) -> np.ndarray:
    """Return the unit vector with the smallest sum of distances to unit vectors (Weiszfeld's iteration)."""
    up = _unit(along.mean(axis=0))
    for _ in range(_MAX_ITERATIONS):
        weight = 1.0 / np.maximum(np.linalg.norm(along - up, axis=-1), 1e-6)
        before, up = up, _unit((weight[:, None] * along).sum(axis=0))
        if np.linalg.norm(up - before) < 1e-9:
            break
    return up


def _feet_support(parts: Sequence[_Bodies], steps: int) -> bool:
    """Return whether a foot stands still nearly whenever the shoulders move."""
    shoulders, feet = [], []
    for part in parts:
        shoulders.append(_moved(part.shoulders, steps).ravel())
        feet.append(np.fmin(*(_moved(ankle, steps) for ankle in part.ankles)).ravel())
    by_shoulders, by_feet = np.concatenate(shoulders), np.concatenate(feet)
    moving = np.isfinite(by_feet) & (by_shoulders > _MIN_STEP_M)
    still = by_feet[moving] < _MAX_FOOT_SHARE * by_shoulders[moving]
    return int(still.sum()) >= _MIN_STEPS and float(still.mean()) >= _MIN_STEP_SHARE


def _moved(points_m: np.ndarray, steps: int) -> np.ndarray:
    """Return how far points move in a number of frames, shape (frame - steps, person)."""
    return np.linalg.norm(points_m[steps:] - points_m[:-steps], axis=-1)


def _evidence(rig: CameraRig, up: np.ndarray, feet_support: bool) -> str | None:
    """Return what confirms that people stand along a direction, as a clause; None if nothing does."""
    image_up = np.array([-camera.rotation[1] for camera in rig.cameras])
    views = np.array([camera.rotation[2] for camera in rig.cameras])
    level = image_up @ up > np.cos(np.radians(_LEVEL_DEG))
    share = float(level.mean())
    around = views[level] - np.outer(views[level] @ up, up)
    around = _unit(around[np.linalg.norm(around, axis=-1) > 1e-9])
    from_sides = bool(len(around)) and float((around @ around.T).min()) < np.cos(np.radians(_MIN_AZIMUTH_DEG))
    cameras = f"{int(level.sum())} of {len(level)} cameras are level"
    if feet_support and share >= _LEVEL_SHARE_WITH_FEET:
        return f"people stand on their feet, and {cameras}"
    if share >= _LEVEL_SHARE and from_sides:
        return f"people are upright, and {cameras}"
    return None


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def _angles_deg(vectors: np.ndarray, direction: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip(vectors @ direction, -1.0, 1.0)))
