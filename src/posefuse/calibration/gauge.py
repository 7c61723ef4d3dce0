"""The world that a bundle adjustment leaves open: what the cameras see stays if all of it is moved, turned or scaled.

Which of these worlds is meant is said by the cameras as they were: most of them are taken to stand where they stood.
The distances by which cameras moved are made as small as they can be in sum, not in squares (a spatial median): one
camera that was bumped does not move the others.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.parameters import N_PARAMETERS, SHIFT, TURN, changed
from posefuse.model.cameras import CameraRig, rotation_from_vector, vector_from_rotation

_ROUNDS = 100
_SETTLED = 1e-12
_LEAST_SHARE = 1e-3
_FREEDOMS = 7


def pose_changes(before: CameraRig, after: CameraRig) -> np.ndarray:
    """Shape (view, 6): turn in radians about the camera's axes, and shift of its centre in metres, of each camera."""
    turns = [
        vector_from_rotation(new.rotation @ old.rotation.T)
        for old, new in zip(before.cameras, after.cameras, strict=True)
    ]
    shifts = [new.centre_m - old.centre_m for old, new in zip(before.cameras, after.cameras, strict=True)]
    return np.concatenate([np.array(turns), np.array(shifts)], axis=1)


def directions(rig: CameraRig, origin_m: np.ndarray) -> np.ndarray:
    """How the cameras' poses change as the whole world does: shape (view, 6, 7).

    The columns are three turns of the world about ``origin_m``, three shifts, and growth.
    """
    out = np.zeros((len(rig), 6, _FREEDOMS))
    for v, camera in enumerate(rig.cameras):
        arm = camera.centre_m - origin_m
        # A world turned by w leaves the camera turned by -R w in its own axes, its centre moved by w x arm.
        out[v, TURN, 0:3] = -camera.rotation
        out[v, SHIFT, 0:3] = -_cross(arm)
        out[v, SHIFT, 3:6] = np.eye(3)
        out[v, SHIFT, 6] = arm
    return out


def _cross(a: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@dataclass(frozen=True, eq=False)
class Gauge:
    """A world chosen: the one in which no small change of it brings the cameras nearer to where they were.

    Attributes:
        basis: shape (view * 9, freedoms): how the cameras' numbers change as the world does; none where enough
            cameras are fixed.
        constraint: shape (view * 9, freedoms): changes of the cameras' numbers in this world are orthogonal to it.
    """

    basis: np.ndarray
    constraint: np.ndarray


def align(
    before: CameraRig, after: CameraRig, points_m: np.ndarray, trusted: np.ndarray
) -> tuple[CameraRig, np.ndarray]:
    """The refined cameras, and the points, in the world of the original ones.

    Args:
        before: the original cameras.
        after: the refined ones, in a world that differs by a similarity.
        points_m: shape (point, 3): what they see, in the world of ``after``.
        trusted: shape (view,), bool: cameras whose original pose says something.
    """
    reach = reach_of(after, points_m)
    for _ in range(_ROUNDS):
        left, origin = pose_changes(before, after), np.median(points_m, axis=0)
        columns, weight = directions(after, origin), closeness(left, reach, trusted)
        matrix = np.einsum("vij,vi,vik->jk", columns, weight, columns)
        step = np.linalg.lstsq(matrix, -np.einsum("vij,vi,vi->j", columns, weight, left), rcond=1e-12)[0]
        after, points_m = transformed(after, points_m, step, origin)
        if np.abs(step).max() < _SETTLED:
            break
    return after, points_m


def transformed(
    rig: CameraRig, points_m: np.ndarray, step: np.ndarray, origin_m: np.ndarray
) -> tuple[CameraRig, np.ndarray]:
    """Cameras and points after a change of their world by the seven numbers of :func:`directions`."""
    turn, growth = rotation_from_vector(step[:3]), np.exp(step[6])
    change = np.zeros((len(rig), N_PARAMETERS))
    for v, camera in enumerate(rig.cameras):
        centre = origin_m + growth * turn @ (camera.centre_m - origin_m) + step[3:6]
        change[v, TURN] = -camera.rotation @ step[:3]
        change[v, SHIFT] = centre - camera.centre_m
    return changed(rig, change), origin_m + growth * (points_m - origin_m) @ turn.T + step[3:6]


def reach_of(rig: CameraRig, points_m: np.ndarray) -> float:
    """How far the cameras are from what they see: a turn by a radian counts as so many metres."""
    centre = np.median(points_m, axis=0)
    return float(np.median([np.linalg.norm(camera.centre_m - centre) for camera in rig.cameras]))


def closeness(left: np.ndarray, reach_m: float, trusted: np.ndarray) -> np.ndarray:
    """Weights of the six numbers of each camera, the more the less it moved: shape (view, 6)."""
    scale = np.array([reach_m] * 3 + [1.0] * 3)
    moved = np.linalg.norm(left * scale, axis=1)
    floor = max(_LEAST_SHARE * reach_m, 0.5 * float(np.median(moved[trusted])))
    weight = np.where(trusted, floor / np.maximum(moved, floor), 0.0)
    return weight[:, None] * scale**2


def gauge_of(
    before: CameraRig, after: CameraRig, points_m: np.ndarray, fixed: np.ndarray, trusted: np.ndarray
) -> Gauge:
    """What keeps the world in its place.

    Fixed cameras hold it: two hold all of it, one all but its size, which the other cameras' distances hold.

    Args:
        before: the original cameras.
        after: the refined ones, aligned.
        points_m: shape (point, 3): what they see.
        fixed: shape (view,), bool: cameras that do not move.
        trusted: shape (view,), bool: cameras whose original pose says something.
    """
    if fixed.sum() >= 2:
        empty = np.zeros((len(after) * N_PARAMETERS, 0))
        return Gauge(empty, empty)
    if fixed.any():
        origin = after.cameras[int(np.flatnonzero(fixed)[0])].centre_m
        poses = directions(after, origin)[:, :, 6:]
    else:
        poses = directions(after, np.median(points_m, axis=0))
    weight = closeness(pose_changes(before, after), reach_of(after, points_m), trusted & ~fixed)
    return Gauge(_rows(poses), _rows(poses * weight[:, :, None]))


def _rows(poses: np.ndarray) -> np.ndarray:
    out = np.zeros((len(poses), N_PARAMETERS, poses.shape[2]))
    out[:, :6] = poses
    return out.reshape(-1, poses.shape[2])


def rescaled(
    before: CameraRig, after: CameraRig, points_m: np.ndarray, fixed: np.ndarray, trusted: np.ndarray
) -> tuple[CameraRig, np.ndarray]:
    """Cameras, and points, around one fixed camera, as far from it as the original cameras were (in the median).

    Args:
        before: the original cameras.
        after: the refined ones.
        points_m: shape (point, 3): what they see.
        fixed: shape (view,), bool: the one camera that does not move.
        trusted: shape (view,), bool: cameras whose original pose says something.
    """
    at = int(np.flatnonzero(fixed)[0])
    origin = after.cameras[at].centre_m
    ratios = [
        np.linalg.norm(before.cameras[v].centre_m - origin) / np.linalg.norm(after.cameras[v].centre_m - origin)
        for v in np.flatnonzero(trusted)
        if v != at
    ]
    growth = float(np.median(ratios)) if ratios else 1.0
    return transformed(after, points_m, np.array([0.0] * 6 + [np.log(growth)]), origin)
