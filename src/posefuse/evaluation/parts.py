"""Share of correct body parts (PCP) by the recipe of Shelf and Campus, and of correct keypoints (PCK).

The recipe is that of VoxelPose's published code, which PlaneSweepPose and Faster VoxelPose share. Each person of the
truth is compared with the closest prediction, however far, and two may share one: what is found too much costs
nothing, so false people must be counted elsewhere.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from posefuse.errors import ResultError, suggestion
from posefuse.evaluation.matching import mean_distances_m
from posefuse.model.cameras import UpAxis
from posefuse.model.skeletons import Skeleton

HeadRule = Literal["shelf", "campus", "none"]
HEAD_RULES: tuple[HeadRule, ...] = get_args(HeadRule)

JOINTS = (
    "right_ankle", "right_knee", "right_hip", "left_hip", "left_knee", "left_ankle", "right_wrist", "right_elbow",
    "right_shoulder", "left_shoulder", "left_elbow", "left_wrist", "bottom_head", "top_head",
)  # fmt: skip
"""The 14 joints of Shelf and Campus."""

LIMBS = {
    "right_lower_leg": (0, 1), "right_upper_leg": (1, 2), "left_upper_leg": (3, 4), "left_lower_leg": (4, 5),
    "right_lower_arm": (6, 7), "right_upper_arm": (7, 8), "left_upper_arm": (9, 10), "left_lower_arm": (10, 11),
    "head": (12, 13),
}  # fmt: skip
PARTS = (*LIMBS, "torso")
"""The ten parts; the torso runs from between the hips to the bottom of the head."""

ALPHA = 0.5
RECALL_M = 0.5
ACTORS = 3
"""Shelf and Campus average their first three actors."""

_R_HIP, _L_HIP, _R_SHOULDER, _L_SHOULDER, _BOTTOM, _TOP = 2, 3, 8, 9, 12, 13


@dataclass(frozen=True)
class PartScores:
    """PCP. NaN where there is nothing to count.

    Attributes:
        alpha: a part is correct whose ends are wrong, on average, by at most this share of its true length.
        head_rule: how head points were had from the result's keypoints.
        parts: names, in order.
        by_actor: a share for each person of the truth.
        by_part: a share for each part, over all people.
        by_actor_and_part: a row a person.
        average: mean over all people.
        average_first_three: mean over the first three, the figure Shelf and Campus are reported by.
        recall_500: share of the truth's person-frames whose closest prediction is less than 0.5 m off.
        n_person_frames: of the truth.
    """

    alpha: float
    head_rule: HeadRule
    parts: tuple[str, ...]
    by_actor: tuple[float, ...]
    by_part: tuple[float, ...]
    by_actor_and_part: tuple[tuple[float, ...], ...]
    average: float
    average_first_three: float
    recall_500: float
    n_person_frames: int


def part_scores(predicted_m: np.ndarray, truth_m: np.ndarray, head_rule: HeadRule, alpha: float = ALPHA) -> PartScores:
    """PCP of predictions against truth.

    A missing joint of the prediction makes its parts wrong and is left out of the distance that finds the closest
    prediction; without predictions all parts are wrong. Parts the truth lacks do not count, nor do head and torso
    under the rule ``none``.

    Args:
        predicted_m: shape (frame, person, 14, 3), joints as :data:`JOINTS`.
        truth_m: shape (frame, actor, 14, 3).
        head_rule: by which the predictions' head was made.
        alpha: share of the true length.
    """
    closest, apart = closest_people(predicted_m, truth_m)
    correct, counted = correct_parts(closest, truth_m, alpha)
    if head_rule == "none":
        counted[..., PARTS.index("head")] = counted[..., PARTS.index("torso")] = False
    correct &= counted
    by_actor = _shares(correct.sum(axis=(0, 2)), counted.sum(axis=(0, 2)))
    there = np.isfinite(truth_m).all(axis=-1).any(axis=-1)
    return PartScores(
        alpha=alpha,
        head_rule=head_rule,
        parts=PARTS,
        by_actor=tuple(by_actor.tolist()),
        by_part=tuple(_shares(correct.sum(axis=(0, 1)), counted.sum(axis=(0, 1))).tolist()),
        by_actor_and_part=tuple(map(tuple, _shares(correct.sum(axis=0), counted.sum(axis=0)).tolist())),
        average=_mean(by_actor),
        average_first_three=_mean(by_actor[:ACTORS]),
        recall_500=float((apart < RECALL_M).sum() / there.sum()) if there.any() else math.nan,
        n_person_frames=int(there.sum()),
    )


def closest_people(predicted_m: np.ndarray, truth_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The closest prediction of each person of the truth: no gate, not one to one.

    Returns:
        Points, shape (frame, actor, joint, 3), and mean distances, shape (frame, actor); NaN where there is none.
    """
    shape = truth_m.shape[:2]
    if not predicted_m.shape[1]:
        return np.full(truth_m.shape, np.nan), np.full(shape, np.nan)
    apart = np.nan_to_num(mean_distances_m(predicted_m, truth_m), nan=np.inf)
    best = apart.argmin(axis=-1)
    least = np.take_along_axis(apart, best[..., None], axis=-1)[..., 0]
    found = predicted_m[np.arange(len(predicted_m))[:, None], best]
    found[~np.isfinite(least)] = np.nan
    return found, np.where(np.isfinite(least), least, np.nan)


def correct_parts(predicted_m: np.ndarray, truth_m: np.ndarray, alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """Which parts are correct, and which the truth has: both of shape (..., part), bool.

    Args:
        predicted_m: shape (..., 14, 3).
        truth_m: shape (..., 14, 3).
        alpha: share of the true length.
    """
    ours, true = _ends(predicted_m), _ends(truth_m)
    errors = np.linalg.norm(ours - true, axis=-1).mean(axis=-1)
    length = np.linalg.norm(true[..., 0, :] - true[..., 1, :], axis=-1)
    return errors <= alpha * length, np.isfinite(length)


def _ends(joints_m: np.ndarray) -> np.ndarray:
    """Shape (..., part, 2, 3)."""
    limbs = joints_m[..., list(LIMBS.values()), :]
    middle = joints_m[..., [_R_HIP, _L_HIP], :].mean(axis=-2)
    torso = np.stack([middle, joints_m[..., _BOTTOM, :]], axis=-2)
    return np.concatenate([limbs, torso[..., None, :, :]], axis=-3)


def _shares(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.divide(part, whole, out=np.full(whole.shape, np.nan), where=whole > 0)


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def joints_14(points_m: np.ndarray, skeleton: Skeleton, rule: HeadRule, up_axis: UpAxis | None = None) -> np.ndarray:
    """The 14 joints of Shelf and Campus from another skeleton's keypoints.

    Head points that the skeleton has by name (``bottom_head``, ``top_head``) are taken as they are; else the rule
    makes them of nose, ears and shoulders.

    Args:
        points_m: shape (..., keypoint, 3).
        skeleton: what the keypoint axis means.
        rule: of the head.
        up_axis: of the world; ``shelf`` knows only z.

    Returns:
        Shape (..., 14, 3), NaN for what cannot be had.

    Raises:
        ResultError: if the rule does not exist, or needs another world.
    """
    if rule not in HEAD_RULES:
        raise ResultError(f"No head rule {rule!r}. {suggestion(rule, HEAD_RULES)}")
    if rule == "shelf" and up_axis not in ("z", None):
        raise ResultError(f"Head rule 'shelf' stretches the head along z, but up is {up_axis} in this world.")

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
    """From between the shoulders through between the ears."""
    bottom = 0.5 * (shoulders + ears)
    return bottom, bottom + 2.0 * (ears - bottom)


def _head_shelf(shoulders: np.ndarray, ears: np.ndarray, nose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mostly along the nose, with the height stretched, as Shelf's annotators placed it."""
    ear_bottom, ear_top = _head_campus(shoulders, ears, nose)
    nose_top = shoulders + (nose - shoulders) * np.array([0.75, 0.75, 1.5])
    nose_bottom = shoulders + 0.5 * (nose - shoulders)
    return 0.75 * nose_bottom + 0.25 * ear_bottom, 0.75 * nose_top + 0.25 * ear_top


def _head_none(shoulders: np.ndarray, ears: np.ndarray, nose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """No head."""
    missing = np.full(shoulders.shape, np.nan)
    return missing, missing


_HEADS: Mapping[HeadRule, Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]] = {
    "shelf": _head_shelf,
    "campus": _head_campus,
    "none": _head_none,
}


def pck(followed_m: np.ndarray, truth_m: np.ndarray, within_m: Sequence[float]) -> tuple[float, ...]:
    """Share of the truth's points that the matched person has within each distance.

    Points of people nobody is matched to, and points the match lacks, are wrong.

    Args:
        followed_m: shape (frame, truth, keypoint, 3): what the result says of each person of the truth.
        truth_m: of the same shape.
        within_m: distances.

    Returns:
        A share for each distance, NaN without truth.
    """
    known = np.isfinite(truth_m).all(axis=-1)
    errors = np.linalg.norm(followed_m - truth_m, axis=-1)[known]
    return tuple(float((errors <= limit).mean()) if errors.size else math.nan for limit in within_m)
