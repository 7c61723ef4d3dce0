"""Linear points: the direct linear transformation of undistorted pixels, in units of the focal length.

Source: Hartley and Zisserman 2004, section 12.2, homogeneous method. The rows of the views are not weighted, as in
FreeMoCap's program. The solution depends on the unit of length, which is that of the calibration file.
"""

from dataclasses import replace

import numpy as np

from posefuse.model.cameras import CameraRig

_BLOCK = 4096


def undistort(rig: CameraRig, pixels: np.ndarray) -> np.ndarray:
    """Return image coordinates on the plane at depth 1 of pixels (point, view, 2), NaN where undefined."""
    coordinates = np.empty(pixels.shape)
    for v, camera in enumerate(rig.cameras):
        rays, _ = camera.rays(pixels[:, v])
        with np.errstate(divide="ignore", invalid="ignore"):
            coordinates[:, v] = np.where(rays[:, 2:] > 0.0, rays[:, :2] / rays[:, 2:], np.nan)
    return coordinates


def linear_points(rig: CameraRig, coordinates: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Return the linear solution of each point.

    Args:
        rig: the cameras.
        coordinates: shape (point, view, 2), of :func:`undistort`.
        used: shape (point, view), bool: views to use; at least two with coordinates.

    Returns:
        Shape (point, 3), in meters, NaN where fewer than two views are used or the solution is at infinity. A point may
        be behind a camera.
    """
    poses = _poses(rig)
    points = np.full((len(coordinates), 3), np.nan)
    used = used & np.isfinite(coordinates).all(axis=-1)
    enough = np.flatnonzero(used.sum(axis=-1) > 1)
    for first in range(0, len(enough), _BLOCK):
        chosen = enough[first : first + _BLOCK]
        rows = coordinates[chosen][..., None] * poses[:, None, 2] - poses[:, :2]
        rows = np.where(used[chosen][..., None, None], rows, 0.0)
        solution = np.linalg.svd(rows.reshape(len(chosen), -1, 4), full_matrices=False)[2][:, -1]
        with np.errstate(divide="ignore", invalid="ignore"):
            found = rig.meters_per_unit * solution[:, :3] / solution[:, 3:]
        points[chosen] = np.where(np.isfinite(found).all(axis=-1, keepdims=True), found, np.nan)
    return points


def undistorted_errors_px(rig: CameraRig, coordinates: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Return reprojection errors of points (point, 3) from the coordinates (point, view, 2), without distortion.

    Returns:
        Shape (point, view), NaN where there is no coordinate.
    """
    homogeneous = np.concatenate([points_m / rig.meters_per_unit, np.ones((len(points_m), 1))], axis=1)
    camera = np.einsum("vij,nj->nvi", _poses(rig), homogeneous)
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = camera[..., :2] / camera[..., 2:] - coordinates
    return focal_lengths_px(rig) * np.linalg.norm(offset, axis=-1)


def image_errors_px(rig: CameraRig, pixels: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Return reprojection errors of points (point, 3) from pixels (point, view, 2), also behind a camera.

    A point behind a camera is projected through its center, as OpenCV does.

    Returns:
        Shape (point, view); without distortion where the lens has no pixel, NaN where there is no detection.
    """
    errors_px = undistorted_errors_px(rig, undistort(rig, pixels), points_m)
    for v, camera in enumerate(rig.cameras):
        local = points_m @ camera.rotation.T + camera.translation_m
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead = local / local[:, 2:]
        distorted, _ = replace(camera, camera_from_world=np.eye(4)).project(ahead)
        error_px = np.linalg.norm(distorted - pixels[:, v], axis=-1)
        errors_px[:, v] = np.where(np.isfinite(error_px), error_px, errors_px[:, v])
    return errors_px


def focal_lengths_px(rig: CameraRig) -> np.ndarray:
    """Return the mean focal length of each camera, shape (view,)."""
    return np.array([0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1]) for camera in rig.cameras])


def _poses(rig: CameraRig) -> np.ndarray:
    """Return the poses world to camera, shape (view, 3, 4), with translations in the unit of the calibration file."""
    poses = np.stack([camera.camera_from_world[:3] for camera in rig.cameras])
    poses[..., 3] /= rig.meters_per_unit
    return poses
