"""Scores of cross-view association in single frames, against an oracle that uses the true assignment."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.errors import ResultError
from posefuse.evaluation.matching import GATE_M, assign, mean_distances_m


@dataclass(frozen=True)
class AssociationScores:
    """Scores over all frames; NaN where nothing is counted.

    Attributes:
        gate_m: maximum distance between a proposal and its person.
        n_true: number of true people.
        n_oracle: number of true people that the oracle detects.
        n_proposals: number of proposals.
        recall: share of the true people that are detected.
        oracle_recall: share that the oracle detects.
        relative_recall: share of the oracle's people that are detected.
        error_mm: mean error over keypoints of detected people that the oracle has too.
        oracle_error_mm: mean error of the oracle's keypoints, over all people it detects.
        error_mm_by_views: number of the oracle's views of a keypoint -> mean error.
        oracle_error_mm_by_views: the same for the oracle.
        false_share: share of proposals without a true person.
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
        oracle_m: by frame, of the truth's shape: triangulated from correctly assigned detections; NaN for people
            that cannot be triangulated.
        oracle_views: by frame, shape (truth, keypoint), int: number of the oracle's views of each keypoint.
        counted: by frame, shape (person,), bool: whether an unmatched proposal counts as false; not if it may
            be a person missing from the truth. By default all count.
        compared: keypoints whose errors count; the others (defined differently in the truth) are used for matching
            only.
        gate_m: maximum mean distance over keypoints of a match.

    Raises:
        ResultError: if the numbers of frames disagree.
    """
    n = {len(each) for each in (proposals_m, truth_m, oracle_m, oracle_views)}
    if len(n) != 1:
        raise ResultError(
            f"Proposals, truth, oracle and its views must have one entry per frame, got {sorted(n)} frames."
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
    """Return by frame the proposal of each true person (NaN without one), and which proposals are matched."""
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
    """Return errors, shape (true people of all frames, keypoint)."""
    offsets = [np.linalg.norm(a - b, axis=-1) for a, b in zip(points_m, truth_m, strict=True)]
    return 1000.0 * np.concatenate(offsets) if offsets else np.empty((0, 0))


def _is_hit(errors_mm: np.ndarray, gate_m: float) -> np.ndarray:
    """Return whether the mean distance is within the gate, shape (true people of all frames,)."""
    known = np.isfinite(errors_mm)
    n = known.sum(axis=-1)
    total = np.where(known, errors_mm, 0.0).sum(axis=-1)
    return (n > 0) & (total <= 1000.0 * gate_m * n)


def _share(flags: np.ndarray) -> float:
    return float(flags.mean()) if flags.size else math.nan


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan
