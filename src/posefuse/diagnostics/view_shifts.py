"""Shifts of whole views: all keypoints of a camera are displaced from the projected points in a common direction.

A detector errs differently at each keypoint. An error that all keypoints of a view share comes from the camera's pose,
its principal point or its clock.
"""

import numpy as np

from posefuse.arrays import column_medians
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Layer
from posefuse.model.status import ViewStatus, is_used
from posefuse.model.tracks import Tracks

SHIFTED_VIEWS = "All keypoints of these views are shifted in a common direction"
"""Beginning of the sentence."""

_LEAST_SHARE = 0.5
"""Least shift of a view that is stated, as a share of the median reprojection error of all views."""
_LEAST_AGREEING = 0.75
"""Least share of the keypoints of a view that are shifted in its direction."""
_LEAST_POINTS, _LEAST_KEYPOINTS = 20, 6


def shift_note(rig: CameraRig, layer: Layer, detections: Detections, tracks: Tracks) -> str | None:
    """Return a sentence if all keypoints of a view are shifted in a common direction, else None.

    Args:
        rig: calibrated cameras.
        layer: triangulated points.
        detections: detections of the same frames.
        tracks: assignment of the detections to the people of the layer.
    """
    if len(rig) < 2:
        return None
    rows, mirror = tracks.rows(detections), detections.skeleton.mirror
    points, status = np.asarray(layer.points_m), np.asarray(layer.view_status)
    shifts, errors = {}, []
    for v, camera in enumerate(rig.cameras):
        present = rows[:, :, v] >= 0
        pixels = np.asarray(detections.keypoints_px)[rows[:, :, v][present]]
        swapped = (status[present][:, :, v] == ViewStatus.USED_SWAPPED)[..., None]
        pixels = np.where(swapped, pixels[:, mirror], pixels)
        residuals = pixels - camera.project(points[present])[0]
        residuals[~is_used(status[present][:, :, v])] = np.nan
        errors.append(np.linalg.norm(residuals, axis=2).ravel())
        shift = common_shift(residuals)
        if shift is not None:
            shifts[camera.name] = float(np.linalg.norm(shift))
    error_px = float(np.nanmedian(np.concatenate(errors))) if shifts else np.nan
    shifts = {name: shift for name, shift in shifts.items() if shift > _LEAST_SHARE * error_px}
    if not shifts:
        return None
    found = ", ".join(f"{shift:.0f} px in {name}" for name, shift in shifts.items())
    return (
        f"{SHIFTED_VIEWS} from the projected 3D points: {found}; the median reprojection error is {error_px:.0f} px. "
        "The detector or inaccurate poses of cameras may cause this; `posefuse refine-calibration` tests the poses, "
        "best on a recording of a person who walks through the whole volume."
    )


def common_shift(residuals_px: np.ndarray) -> np.ndarray | None:
    """Return the shift that the keypoints of a view share, in px, or None if they do not agree on one.

    Args:
        residuals_px: shape (row, keypoint, 2): detected minus projected; NaN where not used.
    """
    counts = np.isfinite(residuals_px[..., 0]).sum(axis=0)
    enough = counts >= _LEAST_POINTS
    if enough.sum() < _LEAST_KEYPOINTS:
        return None
    means = column_medians(residuals_px[:, enough])
    shift = np.median(means, axis=0)
    agreeing = (means @ shift > 0.0).mean()
    return shift if agreeing >= _LEAST_AGREEING else None
