"""Cross-view association by itself: people proposed in single frames, against an oracle that is told who is whose."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.errors import ResultError
from posefuse.evaluation.matching import GATE_M, assign, mean_distances_m


@dataclass(frozen=True)
class AssociationScores:
    """Proposals of all frames. NaN where there is nothing to count by.

    Attributes:
        gate_m: the farthest a proposal may be from the person it is taken for.
        n_true: people of the truth.
        n_oracle: of them, those the oracle finds.
        n_proposals: people proposed.
        recall: share of the truth that is found.
        oracle_recall: share that the oracle finds.
        relative_recall: of the people the oracle finds, the share that is found.
        error_mm: mean distance over keypoints, where people are found and the oracle has the keypoint.
        oracle_error_mm: of the oracle's keypoints, over everybody it finds.
        error_mm_by_views: number of views the oracle had of a keypoint to the mean distance.
        oracle_error_mm_by_views: likewise of the oracle's.
        false_share: proposals that are nobody, of all proposals.
    """

    gate_m: float
    n_true: int
    n_oracle: int
    n_proposals: int
    recall: float
    oracle_recall: float
    relative_recall: float
    error_mm: float
    oracle_error_mm: float
    error_mm_by_views: dict[int, float]
    oracle_error_mm_by_views: dict[int, float]
    false_share: float


def score_association(
    proposals_m: Sequence[np.ndarray],
    truth_m: Sequence[np.ndarray],
    oracle_m: Sequence[np.ndarray],
    oracle_views: Sequence[np.ndarray],
    counted: Sequence[np.ndarray] | None = None,
    compared: Sequence[int] | None = None,
    gate_m: float = GATE_M,
) -> AssociationScores:
    """Score proposals of single frames.

    Args:
        proposals_m: by frame, shape (person, keypoint, 3), NaN where missing.
        truth_m: by frame, shape (truth, keypoint, 3).
        oracle_m: by frame, of the truth's shape: triangulated from detections whose person is known; NaN for people
            that cannot be had.
        oracle_views: by frame, shape (truth, keypoint), int: views of each keypoint the oracle had.
        counted: by frame, shape (person,), bool: whether an unmatched proposal is false; it is not where it may be
            somebody the truth leaves out. By default every one is.
        compared: keypoints whose errors count; the others (of another definition in the truth) only help to match.
        gate_m: the farthest a match may be, as a mean over keypoints.

    Raises:
        ResultError: where the frames do not fit each other.
    """
    n = {len(each) for each in (proposals_m, truth_m, oracle_m, oracle_views)}
    if len(n) != 1:
        raise ResultError(
            f"Proposals, truth, oracle and its views must have one entry a frame, got {sorted(n)} frames."
        )
    found, matched = _matched(proposals_m, truth_m, gate_m)
    own = [np.asarray(each, dtype=np.float64) for each in oracle_m]
    ours, best = (_errors_mm(points, truth_m) for points in (found, own))
    hit, oracle_hit = _is_hit(ours, gate_m), _is_hit(best, gate_m)
    columns = slice(None) if compared is None else list(compared)
    views = np.concatenate([np.asarray(each) for each in oracle_views])[:, columns]
    theirs = np.where(oracle_hit[:, None], best, np.nan)[:, columns]
    mine = np.where(hit[:, None] & np.isfinite(best), ours, np.nan)[:, columns]
    false = sum(
        int((~m if counted is None else ~m & np.asarray(counted[f], dtype=bool)).sum()) for f, m in enumerate(matched)
    )
    n_proposals = sum(len(m) for m in matched)
    return AssociationScores(
        gate_m=gate_m,
        n_true=len(hit),
        n_oracle=int(oracle_hit.sum()),
        n_proposals=n_proposals,
        recall=_share(hit),
        oracle_recall=_share(oracle_hit),
        relative_recall=_share(hit[oracle_hit]),
        error_mm=_mean(mine),
        oracle_error_mm=_mean(theirs),
        error_mm_by_views={int(v): _mean(mine[views == v]) for v in np.unique(views[np.isfinite(theirs)])},
        oracle_error_mm_by_views={int(v): _mean(theirs[views == v]) for v in np.unique(views[np.isfinite(theirs)])},
        false_share=false / n_proposals if n_proposals else math.nan,
    )


def _matched(
    proposals_m: Sequence[np.ndarray], truth_m: Sequence[np.ndarray], gate_m: float
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """By frame: what is proposed for each person of the truth (NaN for nobody), and which proposals are somebody."""
    found, matched = [], []
    for proposals, truth in zip(proposals_m, truth_m, strict=True):
        points = np.full(np.shape(truth), np.nan)
        taken = np.zeros(len(proposals), dtype=bool)
        if len(proposals) and len(truth):
            apart = mean_distances_m(np.asarray(proposals)[None], np.asarray(truth)[None])[0]
            truths, people = assign(apart, apart <= gate_m)
            points[truths] = np.asarray(proposals)[people]
            taken[people] = True
        found.append(points)
        matched.append(taken)
    return found, matched


def _errors_mm(points_m: Sequence[np.ndarray], truth_m: Sequence[np.ndarray]) -> np.ndarray:
    """Shape (truth of all frames, keypoint)."""
    offsets = [np.linalg.norm(a - b, axis=-1) for a, b in zip(points_m, truth_m, strict=True)]
    return 1000.0 * np.concatenate(offsets) if offsets else np.empty((0, 0))


def _is_hit(errors_mm: np.ndarray, gate_m: float) -> np.ndarray:
    """Shape (truth of all frames,): whose mean distance is within the gate."""
    known = np.isfinite(errors_mm)
    n = known.sum(axis=-1)
    total = np.where(known, errors_mm, 0.0).sum(axis=-1)
    return (n > 0) & (total <= 1000.0 * gate_m * n)


def _share(flags: np.ndarray) -> float:
    return float(flags.mean()) if flags.size else math.nan


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan
