"""Check that people are upright and that cameras are above the floor, which reprojection errors do not show.

Calibrated from a flat board or floor, a camera pose can be mirrored: every pixel fits, but the world is upside down.
"""

from collections.abc import Sequence

import numpy as np

from posefuse.errors import choices
from posefuse.model.cameras import CameraRig, up_vector
from posefuse.skeleton.skeletons import Skeleton

_UPPER = ("neck", "left_shoulder", "right_shoulder", "nose", "head_top")
_LOWER = ("left_ankle", "right_ankle", "left_knee", "right_knee")
_UPSIDE_DOWN_COSINE = -0.3
_MIN_POINTS = 10
_FLOOR_QUANTILE = 0.02
_BELOW_M = 0.1


def floor_findings(points_m: Sequence[np.ndarray], skeleton: Skeleton, rig: CameraRig) -> tuple[str | None, ...]:
    """Return :func:`upside_down_finding`, or, if that is None, :func:`below_floor_finding`."""
    upside_down = upside_down_finding(points_m, skeleton, rig)
    return (upside_down or below_floor_finding(points_m, skeleton, rig),)


def upside_down_finding(points_m: Sequence[np.ndarray], skeleton: Skeleton, rig: CameraRig) -> str | None:
    """Return a sentence if people are upside down in a world whose up axis is known, else None.

    Args:
        points_m: arrays of shape (frame, person, keypoint, 3).
        skeleton: of the keypoints; must be human and have ``plausible_m``, otherwise the result is None.
        rig: the cameras.
    """
    upper, lower = ([skeleton.index(n) for n in names if n in skeleton.keypoints] for names in (_UPPER, _LOWER))
    if rig.up_axis is None or not upper or not lower or not skeleton.plausible_m:
        return None
    up = np.array(up_vector(rig.up_axis))
    spans = [_mean_point(part[..., upper, :]) - _mean_point(part[..., lower, :]) for part in points_m]
    cosines = np.concatenate([(span @ up / np.linalg.norm(span, axis=-1)).ravel() for span in spans])
    cosines = cosines[np.isfinite(cosines)]
    if len(cosines) < _MIN_POINTS or np.median(cosines) > _UPSIDE_DOWN_COSINE:
        return None
    opposite = rig.up_axis[1:] if rig.up_axis.startswith("-") else f"-{rig.up_axis}"
    return (
        f"People are upside down: their heads are below their feet along the up axis {rig.up_axis}. Either up is "
        f"{opposite} (`up={opposite!r}`), or the calibration is mirrored, which does not increase reprojection errors "
        "if the board or floor is flat. `align.floor='feet'` estimates the floor from the feet."
    )


def below_floor_finding(points_m: Sequence[np.ndarray], skeleton: Skeleton, rig: CameraRig) -> str | None:
    """Return a sentence if cameras are below the feet of people in a world whose up axis is known, else None.

    Args:
        points_m: arrays of shape (frame, person, keypoint, 3).
        skeleton: of the keypoints.
        rig: the cameras.
    """
    feet = [skeleton.index(name) for name in _LOWER[:2] if name in skeleton.keypoints]
    if rig.up_axis is None or not feet or not skeleton.plausible_m:
        return None
    up = np.array(up_vector(rig.up_axis))
    heights = np.concatenate([(part[..., feet, :] @ up).ravel() for part in points_m])
    heights = heights[np.isfinite(heights)]
    if len(heights) < _MIN_POINTS:
        return None
    floor = float(np.quantile(heights, _FLOOR_QUANTILE))
    low = [camera.name for camera in rig.cameras if camera.center_m @ up < floor - _BELOW_M]
    if not low:
        return None
    cameras = f"Cameras {choices(low)} are" if len(low) > 1 else f"Camera {choices(low)} is"
    return (
        f"{cameras} below the floor on which people stand. The calibration is mirrored, which does not increase "
        f"reprojection errors if the board or floor is flat, or up is not {rig.up_axis} (`up`)."
    )


def _mean_point(points_m: np.ndarray) -> np.ndarray:
    """Return the mean of the finite keypoints, (..., keypoint, 3) to (..., 3), NaN where there is none."""
    finite = np.isfinite(points_m)
    count = finite.sum(axis=-2)
    total = np.where(finite, points_m, 0.0).sum(axis=-2)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
