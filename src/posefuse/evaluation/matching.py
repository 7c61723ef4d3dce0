"""Matching of people in the result with people in the ground truth, per frame and over the recording."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

GATE_M = 0.5
"""Largest mean keypoint distance of a match, in meters."""


@dataclass(frozen=True, eq=False)
class Matches:
    """One-to-one matches of truth and result in every frame.

    Attributes:
        gate_m: largest distance of a match.
        person: shape (frame, truth), int64: matched person of the result; -1 without a match.
        distance_m: shape (frame, truth): distance of the match, NaN without one.
        here: shape (frame, person), bool: where the result has the person.
        true_here: shape (frame, truth), bool: where the truth has the person.
        in_reach: shape (frame, person), bool: where a person of the truth is within the gate, matched or not.
    """

    gate_m: float
    person: np.ndarray
    distance_m: np.ndarray
    here: np.ndarray
    true_here: np.ndarray
    in_reach: np.ndarray

    @property
    def is_matched(self) -> np.ndarray:
        """Shape (frame, truth), bool: whether the person of the truth is matched."""
        return self.person >= 0

    @property
    def person_matched(self) -> np.ndarray:
        """Shape (frame, person), bool: whether the person of the result is matched."""
        matched = np.zeros(self.here.shape, dtype=bool)
        frames, truths = np.nonzero(self.is_matched)
        matched[frames, self.person[frames, truths]] = True
        return matched


def is_here(points_m: np.ndarray) -> np.ndarray:
    """Return where a person has at least one keypoint: (frame, person, keypoint, 3) to (frame, person)."""
    return np.asarray(np.isfinite(points_m).all(axis=-1).any(axis=-1))


def mean_distances_m(points_m: np.ndarray, truth_m: np.ndarray) -> np.ndarray:
    """Return the mean distance over common keypoints for every pair of people.

    Args:
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
        truth_m: shape (frame, truth, keypoint, 3), NaN where missing.

    Returns:
        Shape (frame, truth, person), NaN if two people have no common keypoint.
    """
    found = np.full((points_m.shape[0], truth_m.shape[1], points_m.shape[1]), np.nan)
    # Loop over the truth: all pairs at once would need gigabytes for a long recording.
    for t in range(truth_m.shape[1]):
        apart = np.sqrt(((points_m - truth_m[:, t, None]) ** 2).sum(axis=-1))
        both = np.isfinite(apart)
        n = both.sum(axis=-1)
        total = np.where(both, apart, 0.0).sum(axis=-1)
        np.divide(total, n, out=found[:, t], where=n > 0)
    return found


def match_frames(points_m: np.ndarray, truth_m: np.ndarray, gate_m: float = GATE_M) -> Matches:
    """Match people in every frame: as many pairs within the gate as possible, with the least total distance.

    Unlike in CLEAR MOT (Bernardin and Stiefelhagen 2008), matches of the previous frame have no priority, which would
    hide an identity switch between people closer than the gate.

    Args:
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
        truth_m: shape (frame, truth, keypoint, 3), NaN where missing.
        gate_m: largest mean keypoint distance of a match.
    """
    return matches_of(mean_distances_m(points_m, truth_m), is_here(points_m), is_here(truth_m), gate_m)


def matches_of(apart_m: np.ndarray, here: np.ndarray, true_here: np.ndarray, gate_m: float) -> Matches:
    """Match people from given distances, shape (frame, truth, person)."""
    person = np.full(apart_m.shape[:2], -1, dtype=np.int64)
    distance = np.full(apart_m.shape[:2], np.nan)
    near = apart_m <= gate_m
    for f in np.flatnonzero(near.any(axis=(1, 2))):
        truths, people = assign(apart_m[f], near[f])
        person[f, truths] = people
        distance[f, truths] = apart_m[f, truths, people]
    return Matches(gate_m, person, distance, here, true_here, np.asarray(near.any(axis=1)))


def assign(cost: np.ndarray, allowed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return as many allowed pairs as possible, with the least total cost.

    Args:
        cost: shape (row, column), not negative where allowed.
        allowed: shape (row, column), bool.

    Returns:
        Rows and columns of the pairs.
    """
    if not allowed.any():
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    # More than all others together, so that no pair is dropped for a shorter distance elsewhere.
    prohibitive = 1.0 + cost[allowed].max() * (1 + min(cost.shape))
    rows, columns = linear_sum_assignment(np.where(allowed, cost, prohibitive))
    kept = allowed[rows, columns]
    return rows[kept], columns[kept]


def match_identities(apart_m: np.ndarray, gate_m: float = GATE_M) -> tuple[np.ndarray, np.ndarray]:
    """Match identities over the recording: the one-to-one assignment that agrees in most frames.

    Args:
        apart_m: shape (frame, truth, person), NaN where one of them is absent.
        gate_m: largest distance of agreement.

    Returns:
        Shape (truth,), int64: person of the result, -1 for none; and shape (truth, person): number of frames in which
        they agree.
    """
    together = (apart_m <= gate_m).sum(axis=0)
    person = np.full(together.shape[0], -1, dtype=np.int64)
    truths, people = linear_sum_assignment(together, maximize=True)
    agree = together[truths, people] > 0
    person[truths[agree]] = people[agree]
    return person, together


def followed(values: np.ndarray, person: np.ndarray) -> np.ndarray:
    """Return the result's values for the person matched with each person of the truth.

    Args:
        values: shape (frame, person, ...), float.
        person: shape (frame, truth), int64, -1 for none.

    Returns:
        Shape (frame, truth, ...), NaN without a match.
    """
    if not values.shape[1]:
        return np.full((*person.shape, *values.shape[2:]), np.nan)
    found = values[np.arange(len(values))[:, None], person]
    found[person < 0] = np.nan
    return found
