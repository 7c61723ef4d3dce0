"""Check the scale of the world by the lengths of bones."""

from collections.abc import Sequence

import numpy as np

from posefuse.diagnostics.examination import Examination
from posefuse.model.findings import Finding, FindingKind
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import ADULT_M

_UNITS = {"mm": 1000.0, "cm": 100.0, "m": 1.0}
_MIN_POINTS = 10
_GAIN = 1500.0
_CERTAIN_RATIO = 5.0
"""Ratio of lengths beyond which no body, but a wrong unit of length, is the cause."""
_MAX_SIZE_RATIO = 4.0
"""Largest ratio of a body's extent to the size that its skeleton states; units of length differ by ten at least."""


def find(examination: Examination) -> tuple[Finding, ...]:
    """Return a finding if the triangulated samples show a wrong scale."""
    if examination.points is None:
        return ()
    observations = examination.observations
    points_m = _by_person(examination.points.points_m, observations.keypoint_index, len(observations.skeleton))
    finding = scale_finding([points_m], observations.skeleton, observations.rig.meters_per_unit)
    return () if finding is None else (finding,)


def _by_person(points_m: np.ndarray, keypoint_index: np.ndarray, n_keypoints: int) -> np.ndarray:
    """Return points of shape (sample, column, 3) as (sample, person, keypoint, 3), NaN for keypoints without a column.

    The columns of a person are in the order of the keypoints.
    """
    person = np.cumsum(np.diff(keypoint_index, prepend=n_keypoints) <= 0) - 1
    whole = np.full((len(points_m), int(person.max(initial=-1)) + 1, n_keypoints, 3), np.nan)
    whole[:, person, keypoint_index] = points_m
    return whole


def scale_finding(points_m: Sequence[np.ndarray], skeleton: Skeleton, meters_per_unit: float) -> Finding | None:
    """Return a finding if most bones have implausible lengths, else None.

    Args:
        points_m: arrays of shape (..., keypoint, 3).
        skeleton: its ``plausible_m`` gives the range of each length; without it, the size of its kinematic tree must
            agree with the largest distance between keypoints. Without either, the result is None.
        meters_per_unit: factor by which the lengths of the calibration were multiplied.
    """
    if not skeleton.plausible_m:
        return _size_finding(points_m, skeleton, meters_per_unit)
    ratios, examples = [], []
    for a, b, low, high in skeleton.plausible_m:
        i, j = skeleton.index(a), skeleton.index(b)
        lengths = np.concatenate([np.linalg.norm(p[..., i, :] - p[..., j, :], axis=-1).ravel() for p in points_m])
        lengths = lengths[np.isfinite(lengths)]
        if len(lengths) < _MIN_POINTS:
            continue
        median = float(np.median(lengths))
        ratios.append(median / np.sqrt(low * high))
        if not low <= median <= high:
            examples.append(f"the distance from {a} to {b} is {median:.3g} m, expected {low:g} to {high:g} m")
    if not examples or len(examples) < 0.5 * len(ratios):
        return None
    ratio = float(np.median(ratios))
    return _finding(f"The scale is wrong for this skeleton: {examples[0]}.", ratio, meters_per_unit, stated=True)


def _size_finding(points_m: Sequence[np.ndarray], skeleton: Skeleton, meters_per_unit: float) -> Finding | None:
    """Return a finding if bodies are far larger or smaller than the kinematic tree says, else None."""
    if skeleton.tree is None:
        return None
    extents = np.concatenate([_extents(points) for points in points_m])
    extents = extents[np.isfinite(extents)]
    if len(extents) < _MIN_POINTS:
        return None
    extent, size = float(np.median(extents)), skeleton.tree.size_m
    if size / _MAX_SIZE_RATIO <= extent <= size * _MAX_SIZE_RATIO:
        return None
    sentence = (
        f"The scale is wrong for this skeleton: bodies measure {extent:.3g} m, and the skeleton {skeleton.name!r} "
        f"states a size of {size:.3g} m."
    )
    # A tree without a size has the default, the size of an adult.
    return _finding(sentence, extent / size, meters_per_unit, stated=size != ADULT_M)


def _finding(sentence: str, ratio: float, meters_per_unit: float, *, stated: bool) -> Finding:
    """Return the finding that lengths are too large by a factor."""
    certain = stated and abs(np.log(ratio)) > np.log(_CERTAIN_RATIO)
    remedy = _remedy(ratio, meters_per_unit)
    certainty = 0.99 if certain else 0.8
    return Finding(FindingKind.SCALE, (), None, ratio, "times", np.nan, certainty, _GAIN, sentence, remedy)


def _extents(points: np.ndarray) -> np.ndarray:
    """Return the diagonal of the box around each body with most keypoints, shape (body,); NaN for others."""
    bodies = points.reshape(-1, *points.shape[-2:])
    seen = np.isfinite(bodies[..., 0])
    high, low = (
        edge(np.where(seen[..., None], bodies, -sign * np.inf), axis=1) for edge, sign in ((np.max, 1), (np.min, -1))
    )
    with np.errstate(invalid="ignore"):
        extents = np.linalg.norm(high - low, axis=-1)
    return np.where(2 * seen.sum(axis=1) > seen.shape[1], extents, np.nan)


def _remedy(factor: float, meters_per_unit: float) -> str:
    """Return what to do about lengths that are too large by a factor."""
    unit = next((unit for unit, per in _UNITS.items() if 0.4 < factor / (meters_per_unit * per) < 2.5), None)
    if unit:
        return f"The calibration is probably in {unit}: add `length_unit={unit!r}`."
    return "Check the length unit of the calibration (`length_unit`) and the size of its calibration board."
