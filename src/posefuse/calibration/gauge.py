"""Choose the world coordinates that a bundle adjustment leaves undetermined.

Observations do not change if the whole world is moved, rotated or scaled. The original cameras fix these degrees of
freedom: most of them are assumed to be where they were. The sum of the cameras' displacements is minimized, not the sum
of squares (a spatial median), so that one bumped camera does not shift the others.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.parameters import N_PARAMETERS, ROTATION, TRANSLATION, apply_changes
from posefuse.model.cameras import CameraRig, rotation_from_vector, vector_from_rotation

_MAX_ITERATIONS = 100
_CONVERGED = 1e-12
_MIN_DISTANCE_SHARE = 1e-3
_SIMILARITY_DOF = 7


def pose_changes(before: CameraRig, after: CameraRig) -> np.ndarray:
    """Return the rotation (rad, camera axes) and the shift of the center (m) of each camera, shape (view, 6)."""
    rotations = [
        vector_from_rotation(new.rotation @ old.rotation.T)
        for old, new in zip(before.cameras, after.cameras, strict=True)
    ]
    translations = [new.center_m - old.center_m for old, new in zip(before.cameras, after.cameras, strict=True)]
    return np.concatenate([np.array(rotations), np.array(translations)], axis=1)


def similarity_directions(rig: CameraRig, origin_m: np.ndarray) -> np.ndarray:
    """Return how the cameras' poses change with the whole world, shape (view, 6, 7).

    The columns are three rotations of the world about ``origin_m``, three translations, and the scale.
    """
    out = np.zeros((len(rig), 6, _SIMILARITY_DOF))
    for v, camera in enumerate(rig.cameras):
        arm = camera.center_m - origin_m
        # Rotating the world by w rotates the camera by -R w in its own axes and shifts its center by w x arm.
        out[v, ROTATION, 0:3] = -camera.rotation
        out[v, TRANSLATION, 0:3] = -_cross(arm)
        out[v, TRANSLATION, 3:6] = np.eye(3)
        out[v, TRANSLATION, 6] = arm
    return out


def _cross(a: np.ndarray) -> np.ndarray:
    """Return the cross product matrix of a vector."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@dataclass(frozen=True, eq=False)
class Gauge:
    """Hold a choice of the world: one in which no small similarity brings the cameras closer to their original poses.

    Attributes:
        basis: shape (view * 9, degrees of freedom): change of the camera parameters with the world; no columns if
            enough cameras are fixed.
        constraint: shape (view * 9, degrees of freedom): parameter changes in this world are orthogonal to it.
    """

    basis: np.ndarray
    constraint: np.ndarray


def align(
    before: CameraRig, after: CameraRig, points_m: np.ndarray, trusted: np.ndarray
) -> tuple[CameraRig, np.ndarray]:
    """Return the refined cameras and points in the world of the original ones.

    Args:
        before: original cameras.
        after: refined cameras, in a world that differs by a similarity.
        points_m: shape (point, 3): observed points, in the world of ``after``.
        trusted: shape (view,), bool: cameras whose original pose is informative.
    """
    distance_m = typical_distance_m(after, points_m)
    for _ in range(_MAX_ITERATIONS):
        remaining, origin = pose_changes(before, after), np.median(points_m, axis=0)
        columns, weight = similarity_directions(after, origin), robust_weights(remaining, distance_m, trusted)
        matrix = np.einsum("vij,vi,vik->jk", columns, weight, columns)
        step = np.linalg.lstsq(matrix, -np.einsum("vij,vi,vi->j", columns, weight, remaining), rcond=1e-12)[0]
        after, points_m = apply_similarity(after, points_m, step, origin)
        if np.abs(step).max() < _CONVERGED:
            break
    return after, points_m


def apply_similarity(
    rig: CameraRig, points_m: np.ndarray, step: np.ndarray, origin_m: np.ndarray
) -> tuple[CameraRig, np.ndarray]:
    """Apply a similarity, given by the seven numbers of :func:`similarity_directions`, to cameras and points."""
    rotation, scale_factor = rotation_from_vector(step[:3]), np.exp(step[6])
    change = np.zeros((len(rig), N_PARAMETERS))
    for v, camera in enumerate(rig.cameras):
        center = origin_m + scale_factor * rotation @ (camera.center_m - origin_m) + step[3:6]
        change[v, ROTATION] = -camera.rotation @ step[:3]
        change[v, TRANSLATION] = center - camera.center_m
    return apply_changes(rig, change), origin_m + scale_factor * (points_m - origin_m) @ rotation.T + step[3:6]


def typical_distance_m(rig: CameraRig, points_m: np.ndarray) -> float:
    """Return the median distance of the cameras from the points: the length that corresponds to one radian."""
    center = np.median(points_m, axis=0)
    return float(np.median([np.linalg.norm(camera.center_m - center) for camera in rig.cameras]))


def robust_weights(remaining: np.ndarray, distance_m: float, trusted: np.ndarray) -> np.ndarray:
    """Return weights of the six pose numbers of each camera, larger the less it moved, shape (view, 6)."""
    scale = np.array([distance_m] * 3 + [1.0] * 3)
    distance = np.linalg.norm(remaining * scale, axis=1)
    floor = max(_MIN_DISTANCE_SHARE * distance_m, 0.5 * float(np.median(distance[trusted])))
    weight = np.where(trusted, floor / np.maximum(distance, floor), 0.0)
    return weight[:, None] * scale**2


def choose_gauge(
    before: CameraRig, after: CameraRig, points_m: np.ndarray, fixed: np.ndarray, trusted: np.ndarray
) -> Gauge:
    """Return the gauge that fixes the world.

    Two fixed cameras determine it completely, one all but its scale, which the distances of the other cameras
    determine.

    Args:
        before: original cameras.
        after: refined cameras, aligned.
        points_m: shape (point, 3): observed points.
        fixed: shape (view,), bool: cameras that do not move.
        trusted: shape (view,), bool: cameras whose original pose is informative.
    """
    if fixed.sum() >= 2:
        empty = np.zeros((len(after) * N_PARAMETERS, 0))
        return Gauge(empty, empty)
    if fixed.any():
        origin = after.cameras[int(np.flatnonzero(fixed)[0])].center_m
        poses = similarity_directions(after, origin)[:, :, 6:]
    else:
        poses = similarity_directions(after, np.median(points_m, axis=0))
    weight = robust_weights(pose_changes(before, after), typical_distance_m(after, points_m), trusted & ~fixed)
    return Gauge(_all_parameters(poses), _all_parameters(poses * weight[:, :, None]))


def _all_parameters(poses: np.ndarray) -> np.ndarray:
    """Embed pose directions in all camera parameters."""
    out = np.zeros((len(poses), N_PARAMETERS, poses.shape[2]))
    out[:, :6] = poses
    return out.reshape(-1, poses.shape[2])


def rescale_about_fixed(
    before: CameraRig, after: CameraRig, points_m: np.ndarray, fixed: np.ndarray, trusted: np.ndarray
) -> tuple[CameraRig, np.ndarray]:
    """Scale cameras and points about one fixed camera, to the original median distance of the other cameras.

    Args:
        before: original cameras.
        after: refined cameras.
        points_m: shape (point, 3): observed points.
        fixed: shape (view,), bool: the one camera that does not move.
        trusted: shape (view,), bool: cameras whose original pose is informative.
    """
    at = int(np.flatnonzero(fixed)[0])
    origin = after.cameras[at].center_m
    ratios = [
        np.linalg.norm(before.cameras[v].center_m - origin) / np.linalg.norm(after.cameras[v].center_m - origin)
        for v in np.flatnonzero(trusted)
        if v != at
    ]
    scale_factor = float(np.median(ratios)) if ratios else 1.0
    return apply_similarity(after, points_m, np.array([0.0] * 6 + [np.log(scale_factor)]), origin)
