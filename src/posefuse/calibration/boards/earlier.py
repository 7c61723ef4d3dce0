"""A new calibration compared with an earlier one of the same cameras: which of them moved, and by how much.

The new cameras are placed in the earlier world by the largest group of cameras that kept their poses relative to each
other. The earlier poses of this group are a prior of the new ones.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from posefuse.calibration.stated_covariance import largest_sd
from posefuse.model import camera_covariance as names
from posefuse.model.cameras import Camera, CameraRig, rotation_from_vector, vector_from_rotation

_POSE = (*names.ROTATION, *names.CENTER)
_PRIOR_SD_RAD = np.radians(0.2)
_PRIOR_SD_SHARE = 0.005
"""Assumed standard deviations of earlier poses that state none: rotation, and shares of the distance to the others."""

_MOVED_SD = 3.5
_MIN_TURN_RAD = np.radians(0.3)
_MIN_MOVE_SHARE = 0.01


@dataclass(frozen=True)
class MovedCamera:
    """A camera whose pose changed.

    Attributes:
        name: name of the camera.
        turned_deg: angle between its orientations.
        moved_m: distance between its positions.
    """

    name: str
    turned_deg: float
    moved_m: float

    def __str__(self) -> str:
        return f"{self.name!r} (turned by {self.turned_deg:.2f} degrees, moved by {1000 * self.moved_m:.0f} mm)"


@dataclass(frozen=True, eq=False)
class EarlierComparison:
    """Result of a comparison with an earlier calibration.

    Attributes:
        rig: the new cameras in the earlier world, or unchanged if no two cameras kept their relative pose.
        moved: cameras that moved.
        kept: names of the cameras that did not.
    """

    rig: CameraRig
    moved: tuple[MovedCamera, ...]
    kept: tuple[str, ...]


def compare_with_earlier(rig: CameraRig, earlier: CameraRig) -> EarlierComparison:
    """Place new cameras in the world of an earlier calibration, and name those that moved.

    Args:
        rig: the new cameras.
        earlier: cameras of an earlier calibration; cameras are compared by their names.
    """
    shared = [name for name in rig.names if name in earlier.names]
    centers = np.array([rig[name].center_m for name in shared]).reshape(-1, 3)
    reach = max(float(np.median(np.linalg.norm(centers - centers.mean(axis=0), axis=1))) if len(shared) else 0.0, 1e-3)
    best: tuple[tuple[int, float], CameraRig, list[str]] | None = None
    for anchor in shared:
        placed = _placed(rig, np.linalg.inv(rig[anchor].camera_from_world) @ earlier[anchor].camera_from_world)
        kept = [name for name in shared if _is_kept(placed, earlier, name, anchor, reach)]
        change = sum(float(np.linalg.norm(_difference(placed[n], earlier[n]) / _limits(reach))) for n in kept)
        score = len(kept), -change
        if best is None or score > best[0]:
            best = score, placed, kept
    if best is None or len(best[2]) < 2:
        return EarlierComparison(rig, (), ())
    _, placed, kept = best
    placed = replace(placed, up_axis=earlier.up_axis, inferred_up=earlier.inferred_up)
    moved = tuple(_moved(placed[name], earlier[name]) for name in shared if name not in kept)
    return EarlierComparison(_with_prior(placed, earlier, kept, reach), moved, tuple(kept))


def _placed(rig: CameraRig, new_from_earlier: np.ndarray) -> CameraRig:
    """Return the cameras in another world."""
    cameras = tuple(replace(c, camera_from_world=c.camera_from_world @ new_from_earlier) for c in rig.cameras)
    return replace(rig, cameras=cameras)


def _difference(found: Camera, earlier: Camera) -> np.ndarray:
    """Return rotation (rad) and shift (m) from a camera to its earlier pose, about and along its axes, shape (6,)."""
    turn = vector_from_rotation(earlier.rotation @ found.rotation.T)
    return np.concatenate([turn, found.rotation @ (earlier.center_m - found.center_m)])


def _limits(reach_m: float) -> np.ndarray:
    return np.array([_PRIOR_SD_RAD] * 3 + [_PRIOR_SD_SHARE * reach_m] * 3)


def _covariance(rig: CameraRig, name: str, default_sd: np.ndarray | None) -> np.ndarray:
    """Return the covariance of a pose; that of a file without one is assumed, that of a reference camera is 0."""
    known = rig.covariance(name)
    if known is not None:
        return known.block(_POSE)
    if default_sd is not None and not rig.covariances:
        return np.diag(default_sd**2)
    return np.zeros((6, 6))


def _is_kept(rig: CameraRig, earlier: CameraRig, name: str, anchor: str, reach_m: float) -> bool:
    """Return whether a camera is where it was, within the uncertainty of both calibrations and of the anchor."""
    difference = _difference(rig[name], earlier[name])
    both = [_covariance(r, n, _limits(reach_m)) for r in (rig, earlier) for n in dict.fromkeys((name, anchor))]
    covariance = np.sum(both, axis=0)
    sd = largest_sd(covariance[:3, :3]), largest_sd(covariance[3:, 3:])
    # The error of the anchor's rotation moves the others.
    lever = sd[0] * float(np.linalg.norm(rig[name].center_m - rig[anchor].center_m))
    most = max(_MOVED_SD * sd[0], _MIN_TURN_RAD), max(_MOVED_SD * np.hypot(sd[1], lever), _MIN_MOVE_SHARE * reach_m)
    return bool(np.linalg.norm(difference[:3]) <= most[0] and np.linalg.norm(difference[3:]) <= most[1])


def _moved(found: Camera, earlier: Camera) -> MovedCamera:
    difference = _difference(found, earlier)
    turned, moved = np.linalg.norm(difference[:3]), np.linalg.norm(difference[3:])
    return MovedCamera(found.name, float(np.degrees(turned)), float(moved))


def _with_prior(rig: CameraRig, earlier: CameraRig, kept: list[str], reach_m: float) -> CameraRig:
    """Return the cameras that did not move at the mean of both poses, weighted by their precision.

    The errors of such a mean are those of both calibrations times its weights, from which the covariance of all
    cameras follows.
    """
    if not rig.covariances:
        return rig
    parameters = [(known.camera, name) for known in rig.covariances for name in known.parameters]
    whole, before = _whole(rig), _earlier_poses(earlier, kept, reach_m)
    keep, take = np.eye(len(parameters)), np.zeros((len(parameters), 6 * len(kept)))
    cameras = {camera.name: camera for camera in rig.cameras}
    for k, name in enumerate(kept):
        own = rig.covariance(name)
        if own is None or not set(_POSE) <= set(own.parameters):
            continue
        new, old = own.block(_POSE), before[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]
        gain = np.linalg.solve(new + old + np.diag(1e-9 * np.diag(new)), new).T
        at = [parameters.index((name, each)) for each in _POSE]
        keep[np.ix_(at, at)] -= gain
        take[np.ix_(at, range(6 * k, 6 * k + 6))] = gain
        cameras[name] = _stepped(cameras[name], gain @ _difference(cameras[name], earlier[name]))
    combined = keep @ whole @ keep.T + take @ before @ take.T
    covariances, correlation = names.separated(parameters, combined, rig.covariances[0].reference)
    known = None if rig.correlation is None else correlation
    return replace(rig, cameras=tuple(cameras.values()), covariances=covariances, correlation=known)


def _whole(rig: CameraRig) -> np.ndarray:
    """Return the covariance of all parameters; without correlations between cameras if the rig does not state them."""
    joint = rig.covariance()
    if joint is not None:
        return joint.matrix
    return np.asarray(block_diag(*(known.matrix for known in rig.covariances)))


def _earlier_poses(earlier: CameraRig, kept: list[str], reach_m: float) -> np.ndarray:
    """Return the covariance of the earlier poses of some cameras, shape (6 * camera,) twice."""
    joint = earlier.covariance()
    if joint is not None:
        return joint.block([(name, each) for name in kept for each in _POSE])
    return np.asarray(block_diag(*(_covariance(earlier, name, _limits(reach_m)) for name in kept)))


def _stepped(camera: Camera, step: np.ndarray) -> Camera:
    """Return a camera after a rotation about and a shift along its axes."""
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_vector(step[:3]) @ camera.rotation
    pose[:3, 3] = -pose[:3, :3] @ (camera.center_m + camera.rotation.T @ step[3:])
    return replace(camera, camera_from_world=pose)
