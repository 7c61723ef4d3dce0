"""Percentage of correct parts (PCP) as for Shelf and Campus, and of correct keypoints (PCK).

PCP follows VoxelPose's published code, shared by PlaneSweepPose and Faster VoxelPose. Each person of the truth is
compared with the closest prediction, however far, and two may share one. False people cost nothing and must be counted
separately.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.evaluation.head_points import HeadRule
from posefuse.evaluation.matching import mean_distances_m

LIMBS = {
    "right_lower_leg": (0, 1), "right_upper_leg": (1, 2), "left_upper_leg": (3, 4), "left_lower_leg": (4, 5),
    "right_lower_arm": (6, 7), "right_upper_arm": (7, 8), "left_upper_arm": (9, 10), "left_lower_arm": (10, 11),
    "head": (12, 13),
}  # fmt: skip
PARTS = (*LIMBS, "torso")
"""The ten parts; the torso extends from mid-hip to the bottom of the head."""

ALPHA = 0.5
RECALL_M = 0.5
ACTORS = 3
"""Shelf and Campus average their first three actors."""

_R_HIP, _L_HIP, _BOTTOM = 2, 3, 12


@dataclass(frozen=True)
class PartScores:
    """PCP. NaN where undefined.

    Attributes:
        alpha: a part is correct if the mean error of its ends is at most this fraction of its true length.
        head_rule: rule for the head points of the result.
        parts: names, in order.
        by_actor: fraction per person of the truth.
        by_part: fraction per part, over all people.
        by_actor_and_part: one row per person.
        average: mean over all people.
        average_first_three: mean over the first three people, as reported for Shelf and Campus.
        recall_500: fraction of the truth's person-frames whose closest prediction is less than 0.5 m away.
        n_person_frames: number of person-frames of the truth.
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
    """Return PCP of predictions against truth.

    Parts with a missing predicted joint count as wrong; the joint is ignored when the closest prediction is
    determined. Without predictions, all parts are wrong. Parts that the truth lacks do not count, nor do head and torso
    with the rule ``none``.

    Args:
        predicted_m: shape (frame, person, 14, 3), joints in the order of
            :data:`posefuse.evaluation.head_points.JOINTS`.
        truth_m: shape (frame, actor, 14, 3).
        head_rule: head rule of the predictions.
        alpha: fraction of the true length.
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
    """Return the closest prediction for each person of the truth, without gate and not one-to-one.

    Returns:
        Points, shape (frame, actor, joint, 3), and mean distances, shape (frame, actor); NaN without a prediction.
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
    """Return which parts are correct and which exist in the truth: shapes (..., part), bool.

    Args:
        predicted_m: shape (..., 14, 3).
        truth_m: shape (..., 14, 3).
        alpha: fraction of the true length.
    """
    ours, true = _ends(predicted_m), _ends(truth_m)
    errors = np.linalg.norm(ours - true, axis=-1).mean(axis=-1)
    length = np.linalg.norm(true[..., 0, :] - true[..., 1, :], axis=-1)
    return errors <= alpha * length, np.isfinite(length)


def _ends(joints_m: np.ndarray) -> np.ndarray:
    """Return the ends of the parts, shape (..., part, 2, 3)."""
    limbs = joints_m[..., list(LIMBS.values()), :]
    middle = joints_m[..., [_R_HIP, _L_HIP], :].mean(axis=-2)
    torso = np.stack([middle, joints_m[..., _BOTTOM, :]], axis=-2)
    return np.concatenate([limbs, torso[..., None, :, :]], axis=-3)


def _shares(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.divide(part, whole, out=np.full(whole.shape, np.nan), where=whole > 0)


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def pck(matched_m: np.ndarray, truth_m: np.ndarray, within_m: Sequence[float]) -> tuple[float, ...]:
    """Share of the truth's points that the matched person has within each distance.

    Points of unmatched people, and points that the match lacks, count as wrong.

    Args:
        matched_m: shape (frame, truth, keypoint, 3): points of the result for each person of the truth.
        truth_m: points of the truth, same shape.
        within_m: distances in meters.

    Returns:
        One fraction per distance, NaN without truth.
    """
    known = np.isfinite(truth_m).all(axis=-1)
    errors = np.linalg.norm(matched_m - truth_m, axis=-1)[known]
    return tuple(float((errors <= limit).mean()) if errors.size else math.nan for limit in within_m)
