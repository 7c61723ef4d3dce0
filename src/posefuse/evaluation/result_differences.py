"""Differences between two results of the same recording."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from posefuse.arguments import checked
from posefuse.errors import ResultError
from posefuse.evaluation.matching import is_here, mean_distances_m
from posefuse.evaluation.paired_results import PeoplePoints, people_points
from posefuse.model.reconstruction import Reconstruction

_FAR_M = 1e6


@dataclass(frozen=True)
class KeypointDifference:
    """Differences of one keypoint of one person.

    Attributes:
        keypoint: name of the keypoint.
        n: number of frames in which both results have it.
        median_mm: median distance; NaN without common frames.
        p95_mm: 95th percentile of distances.
        rms_mm: root mean square distance.
        only_in_first: number of frames in which only the first result has it.
        only_in_second: number of frames in which only the second result has it.
    """

    keypoint: str
    n: int
    median_mm: float
    p95_mm: float
    rms_mm: float
    only_in_first: int
    only_in_second: int


@dataclass(frozen=True)
class PersonDifference:
    """Differences of one person.

    Attributes:
        first: name in the first result.
        second: name in the second result.
        n_frames: number of frames in which both results have the person.
        whole: differences of all keypoints together; its keypoint is ``all``.
        keypoints: differences of each common keypoint.
    """

    first: str
    second: str
    n_frames: int
    whole: KeypointDifference
    keypoints: tuple[KeypointDifference, ...]


@dataclass(frozen=True)
class ResultDifferences:
    """Differences between two results.

    Attributes:
        layers: layer compared in the first and in the second result.
        n_frames: number of common frames.
        matched_by: how frames were matched.
        people: people that both results have.
        only_in_first: names of people without a counterpart in the second result.
        only_in_second: names of people without a counterpart in the first result.
    """

    layers: tuple[str, str]
    n_frames: int
    matched_by: str
    people: tuple[PersonDifference, ...]
    only_in_first: tuple[str, ...]
    only_in_second: tuple[str, ...]


@checked
def result_differences(first: Reconstruction, second: Reconstruction) -> ResultDifferences:
    """Compare two results of one recording in the same coordinate system.

    Each person is compared with the one of the other result at the smallest mean distance over the recording; people
    who never appear in the same frame have no counterpart.

    Args:
        first: result in meters; ``options.layer`` or the best layer is compared.
        second: result in meters.

    Raises:
        ResultError: if a result is not in meters, or they share no frame or no keypoint.
    """
    if second.unit != "m":
        raise ResultError(f"The second result is in {second.unit} and cannot be compared in 3D.")
    paired = people_points(first, second)
    pairs = _counterparts(paired)
    taken = {i for i, _ in pairs}, {j for _, j in pairs}
    return ResultDifferences(
        (paired.layer, second.best_layer()[0]),
        len(paired.points_m),
        paired.matched_by,
        tuple(_person(paired, i, j) for i, j in pairs),
        tuple(name for i, name in enumerate(paired.person_ids) if i not in taken[0]),
        tuple(name for j, name in enumerate(paired.truth_ids) if j not in taken[1]),
    )


def _counterparts(paired: PeoplePoints) -> list[tuple[int, int]]:
    """Return pairs of indices in the first and second result, in the order of the first."""
    distances = mean_distances_m(paired.points_m, paired.truth_m)
    known = np.isfinite(distances)
    total = np.where(known, distances, 0.0).sum(axis=0)
    mean = np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), _FAR_M)
    seconds, firsts = linear_sum_assignment(mean)
    found = [(int(i), int(j)) for j, i in zip(seconds, firsts, strict=True) if mean[j, i] < _FAR_M]
    return sorted(found)


def _person(paired: PeoplePoints, first: int, second: int) -> PersonDifference:
    ours, theirs = paired.points_m[:, first], paired.truth_m[:, second]
    both = is_here(ours[:, None]) & is_here(theirs[:, None])
    rows = [_keypoint(name, ours[:, [k]], theirs[:, [k]]) for k, name in enumerate(paired.skeleton.keypoints)]
    return PersonDifference(
        paired.person_ids[first],
        paired.truth_ids[second],
        int(both.sum()),
        _keypoint("all", ours, theirs),
        tuple(rows),
    )


def _keypoint(name: str, ours: np.ndarray, theirs: np.ndarray) -> KeypointDifference:
    has, other = np.isfinite(ours).all(axis=-1), np.isfinite(theirs).all(axis=-1)
    distances_mm = 1000.0 * np.linalg.norm(ours - theirs, axis=-1)[has & other]
    nan = float("nan")
    median, p95 = np.percentile(distances_mm, [50, 95]) if len(distances_mm) else (nan, nan)
    rms = float(np.sqrt(np.mean(distances_mm**2))) if len(distances_mm) else nan
    return KeypointDifference(
        name, len(distances_mm), float(median), float(p95), rms, int((has & ~other).sum()), int((~has & other).sum())
    )
