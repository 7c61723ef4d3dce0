"""Covariance of calibrated cameras as calibration files state it: by the names of the estimated parameters."""

from dataclasses import replace

import numpy as np

from posefuse.model.camera_covariance import parameter_names, separated
from posefuse.model.cameras import CameraRig

POSE_AND_LENS = 18
"""Number of parameters of a camera: three rotations about its axes (rad), three shifts of its center (m), fx, fy, cx
and cy (px), and eight distortion coefficients."""
_CENTER = slice(3, 6)


def with_covariances(rig: CameraRig, world: CameraRig, covariance: np.ndarray, free: np.ndarray) -> CameraRig:
    """Return a rig with the covariances of its estimated parameters, with the shifts of the centers in camera axes.

    Args:
        rig: the cameras, in any world of the same scale.
        world: the same cameras in the world of ``covariance``, whose first camera defines the poses.
        covariance: shape (view, P, view, P), P at least 18: by :data:`POSE_AND_LENS`, the centers in that world.
        free: shape (view, P), bool: whether a parameter was estimated.
    """
    n_views, size = free.shape
    turn = np.tile(np.eye(size), (n_views, 1, 1))
    parameters: list[tuple[str, str]] = []
    rows: list[int] = []
    for v, camera in enumerate(world.cameras):
        turn[v, _CENTER, _CENTER] = camera.rotation
        all_names = parameter_names(camera.lens)
        used = np.flatnonzero(free[v, : len(all_names)])
        parameters += [(camera.name, all_names[i]) for i in used]
        rows += [v * size + int(i) for i in used]
    if not rows:
        return rig
    turned = np.einsum("vij,vjwk,wlk->viwl", turn, covariance, turn).reshape(n_views * size, -1)
    covariances, correlation = separated(parameters, turned[np.ix_(rows, rows)], world.names[0])
    return replace(rig, covariances=covariances, correlation=correlation)


def largest_sd(covariance: np.ndarray) -> float:
    """Return the standard deviation in the least certain direction."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
