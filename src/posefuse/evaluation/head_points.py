"""The 14 joints of the Shelf and Campus annotations, derived from other skeletons.

Their heads have a bottom and a top, which detectors do not report. Published figures depend on the rule that replaces
them (on Shelf by up to 0.6 points of PCP), so every figure names its rule. The rules are those of VoxelPose's code.
"""

from collections.abc import Callable, Mapping
from typing import Literal, get_args

import numpy as np

from posefuse.errors import ResultError, suggestion
from posefuse.model.cameras import UpAxis
from posefuse.skeleton.skeletons import Skeleton

HeadRule = Literal["shelf", "campus", "none"]
HEAD_RULES: tuple[HeadRule, ...] = get_args(HeadRule)

JOINTS = (
    "right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "right_wrist", "right_elbow",
    "right_shoulder", "left_shoulder", "left_elbow", "left_wrist", "bottom_head", "top_head",
)  # fmt: skip
"""The 14 joints of Shelf and Campus."""

_R_SHOULDER, _L_SHOULDER, _BOTTOM, _TOP = 8, 9, 12, 13


def joints_14(points_m: np.ndarray, skeleton: Skeleton, rule: HeadRule, up_axis: UpAxis | None = None) -> np.ndarray:
    """Return the 14 joints of Shelf and Campus from another skeleton's keypoints.

    Head points of the skeleton (``bottom_head``, ``top_head``) are used directly; otherwise the rule derives them from
    nose, ears and shoulders.

    Args:
        points_m: shape (..., keypoint, 3).
        skeleton: skeleton of the keypoint axis.
        rule: head rule.
        up_axis: up axis of the world; ``shelf`` requires z.

    Returns:
        Shape (..., 14, 3), NaN where undefined.

    Raises:
        ResultError: if the rule does not exist or requires another up axis.
    """
    if rule not in HEAD_RULES:
        raise ResultError(f"Unknown head rule {rule!r}. {suggestion(rule, HEAD_RULES)}")
    if rule == "shelf" and up_axis not in ("z", None):
        raise ResultError(f"Head rule 'shelf' needs a world with z up; the up axis is {up_axis}.")

    def point(name: str) -> np.ndarray:
        if name in skeleton.keypoints:
            return points_m[..., skeleton.index(name), :]
        return np.full((*points_m.shape[:-2], 3), np.nan)

    joints = np.stack([point(name) for name in JOINTS], axis=-2)
    if "bottom_head" not in skeleton.keypoints and "top_head" not in skeleton.keypoints:
        middle = 0.5 * (joints[..., _R_SHOULDER, :] + joints[..., _L_SHOULDER, :])
        ears = 0.5 * (point("left_ear") + point("right_ear"))
        joints[..., _BOTTOM, :], joints[..., _TOP, :] = _HEADS[rule](middle, ears, point("nose"))
    return joints


def _head_campus(shoulders: np.ndarray, ears: np.ndarray, nose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return head points on the line from mid-shoulders through mid-ears."""
    bottom = 0.5 * (shoulders + ears)
    return bottom, bottom + 2.0 * (ears - bottom)


def _head_shelf(shoulders: np.ndarray, ears: np.ndarray, nose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return head points mostly along the nose with increased height, as in Shelf's annotations."""
    ear_bottom, ear_top = _head_campus(shoulders, ears, nose)
    nose_top = shoulders + (nose - shoulders) * np.array([0.75, 0.75, 1.5])
    nose_bottom = shoulders + 0.5 * (nose - shoulders)
    return 0.75 * nose_bottom + 0.25 * ear_bottom, 0.75 * nose_top + 0.25 * ear_top


def _head_none(shoulders: np.ndarray, ears: np.ndarray, nose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return missing head points."""
    missing = np.full(shoulders.shape, np.nan)
    return missing, missing


_HEADS: Mapping[HeadRule, Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]] = {
    "shelf": _head_shelf,
    "campus": _head_campus,
    "none": _head_none,
}
