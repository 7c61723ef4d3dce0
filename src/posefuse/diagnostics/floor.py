"""Are people upright, and do the cameras stand above the floor? Reprojection errors do not tell.

From a flat board or floor a camera's pose can come out mirrored: every pixel fits, and the world stands on its head.
"""

from collections.abc import Sequence

import numpy as np

from posefuse.errors import choices
from posefuse.model.cameras import CameraRig, up_vector
from posefuse.skeleton.skeletons import Skeleton

_HEADS = ("neck", "left_shoulder", "right_shoulder", "nose", "head_top")
_FEET = ("left_ankle", "right_ankle", "left_knee", "right_knee")
_UPSIDE_DOWN = -0.3
_FEWEST = 10
_LOW_SHARE = 0.02
_BELOW_M = 0.1


def floor_findings(points_m: Sequence[np.ndarray], skeleton: Skeleton, rig: CameraRig) -> tuple[str | None, ...]:
    """What :func:`upright_finding` says, and unless that explains it what :func:`below_floor_finding` says."""
    upside_down = upright_finding(points_m, skeleton, rig)
    return (upside_down or below_floor_finding(points_m, skeleton, rig),)


def upright_finding(points_m: Sequence[np.ndarray], skeleton: Skeleton, rig: CameraRig) -> str | None:
    """A sentence if people hang head down in a world whose up axis is known, else None.

    Args:
        points_m: arrays of shape (frame, person, keypoint, 3).
        skeleton: of the keypoints; nothing is said of other bodies than humans, nor where it knows no body's lengths.
        rig: the cameras.
    """
    heads, feet = ([skeleton.index(n) for n in names if n in skeleton.keypoints] for names in (_HEADS, _FEET))
    if rig.up_axis is None or not heads or not feet or not skeleton.plausible_m:
        return None
    up = np.array(up_vector(rig.up_axis))
    spans = [_middle(part[..., heads, :]) - _middle(part[..., feet, :]) for part in points_m]
    along = np.concatenate([(span @ up / np.linalg.norm(span, axis=-1)).ravel() for span in spans])
    along = along[np.isfinite(along)]
    if len(along) < _FEWEST or np.median(along) > _UPSIDE_DOWN:
        return None
    other = rig.up_axis[1:] if rig.up_axis.startswith("-") else f"-{rig.up_axis}"
    return (
        f"People hang head down: their heads are below their feet along the world's up axis {rig.up_axis}. Either up "
        f"is {other} (--up {other}), or the calibration is mirrored, as from a flat board or floor it can be: it fits "
        "every pixel all the same. --align floor finds the floor from feet."
    )


def below_floor_finding(points_m: Sequence[np.ndarray], skeleton: Skeleton, rig: CameraRig) -> str | None:
    """A sentence if cameras stand below the feet of people in a world whose up axis is known, else None.

    Args:
        points_m: arrays of shape (frame, person, keypoint, 3).
        skeleton: of the keypoints.
        rig: the cameras.
    """
    feet = [skeleton.index(name) for name in _FEET[:2] if name in skeleton.keypoints]
    if rig.up_axis is None or not feet or not skeleton.plausible_m:
        return None
    up = np.array(up_vector(rig.up_axis))
    heights = np.concatenate([(part[..., feet, :] @ up).ravel() for part in points_m])
    heights = heights[np.isfinite(heights)]
    if len(heights) < _FEWEST:
        return None
    floor = float(np.quantile(heights, _LOW_SHARE))
    low = [camera.name for camera in rig.cameras if camera.centre_m @ up < floor - _BELOW_M]
    if not low:
        return None
    many = len(low) > 1
    return (
        f"Camera{'s' * many} {choices(low)} stand{'' if many else 's'} below the feet of people, under the floor. The "
        f"calibration is mirrored (from a flat board or floor it can be: it fits every pixel all the same), or up is "
        f"not {rig.up_axis} (--up)."
    )


def _middle(points_m: np.ndarray) -> np.ndarray:
    """The mean of the keypoints that are known: (..., keypoint, 3) to (..., 3), NaN where none is."""
    known = np.isfinite(points_m)
    count = known.sum(axis=-2)
    total = np.where(known, points_m, 0.0).sum(axis=-2)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
