"""Frames from which a person is estimated: a sample of the recording, and those in which the person stands upright."""

import numpy as np

from posefuse.biomechanics.inverse_kinematics import PersonPoints, person_points
from posefuse.biomechanics.marker_model import MarkerModel
from posefuse.biomechanics.subject_fit import Sample, moving_sample, upright_sample
from posefuse.skeleton.skeletons import Skeleton

_MOST_CANDIDATES, _MOST_SAMPLES, _MIN_KEYPOINTS = 240, 48, 6
_CORRELATION_S = 0.4
"""Interval between frames with independent errors: twice the time over which errors of detectors are correlated."""
_STRAIGHT_DEG, _UPRIGHT_DEG = 12.0, 10.0


class CandidateFrames:
    """At most a few hundred frames of a person, evenly spaced, collected while the recording is read in order.

    Args:
        n_frames: number of frames of the recording.
    """

    def __init__(self, n_frames: int) -> None:
        self._step = max(1, n_frames // _MOST_CANDIDATES)
        self._early = _MOST_SAMPLES
        self._numbers: list[int] = []
        self._points: list[np.ndarray] = []
        self._covariances: list[np.ndarray] = []

    def add(self, start: int, points_m: np.ndarray, covariance_m2: np.ndarray) -> None:
        """Add what is needed of consecutive frames.

        Args:
            start: index of the first frame.
            points_m: shape (frame, keypoint, 3).
            covariance_m2: shape (frame, keypoint, 6).
        """
        usable = np.isfinite(points_m).all(axis=-1).sum(axis=1) >= _MIN_KEYPOINTS
        for t in np.flatnonzero(usable):
            # The first frames are kept too, for people who are present for a short time only.
            if (start + t) % self._step == 0 or len(self._numbers) < self._early:
                self._numbers.append(start + int(t))
                self._points.append(points_m[t].copy())
                self._covariances.append(covariance_m2[t].copy())

    def chosen(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return frame indices, points and covariances."""
        if not self._numbers:
            return np.empty(0, dtype=int), np.empty((0, 0, 3)), np.empty((0, 0, 6))
        numbers = np.array(self._numbers)
        even = numbers % self._step == 0
        # Early frames would outnumber the others.
        use = even if even.sum() >= _MOST_SAMPLES // 2 else np.ones(len(numbers), dtype=bool)
        return numbers[use], np.array(self._points)[use], np.array(self._covariances)[use]

    def names_and_points(self, skeleton: Skeleton) -> tuple[np.ndarray, tuple[str, ...]]:
        """Return the points and the names of their keypoints."""
        _, points, _ = self.chosen()
        return (points if len(points) else np.empty((0, len(skeleton), 3))), skeleton.keypoints


def samples_of(
    model: MarkerModel,
    candidates: CandidateFrames,
    vertical: np.ndarray,
    rate_hz: float,
    static: PersonPoints | None,
) -> tuple[Sample, ...]:
    """Return the samples from which a person is estimated.

    Args:
        model: the unscaled model.
        candidates: frames of the person.
        vertical: shape (3, 3): rotation to axes with y up.
        rate_hz: frame rate.
        static: points of a static trial; without it, standing phases are searched for in the recording.
    """
    numbers, points, covariance = candidates.chosen()
    if not len(numbers):
        return () if static is None else (upright_sample(static, is_static=True),)
    person = person_points(model, points, covariance, vertical)
    rows = np.unique(np.linspace(0, len(numbers) - 1, min(_MOST_SAMPLES, len(numbers))).astype(int))
    spacing_s = float(numbers[rows[-1]] - numbers[rows[0]]) / max(len(rows) - 1, 1) / rate_hz
    samples = [moving_sample(person.rows(rows), min(1.0, max(spacing_s, 1.0 / rate_hz) / _CORRELATION_S))]
    if static is not None:
        return (*samples, upright_sample(static, is_static=True))
    standing = np.flatnonzero(is_upright(model, person))
    if len(standing):
        some = standing[np.linspace(0, len(standing) - 1, min(8, len(standing))).astype(int)]
        samples.append(upright_sample(person.rows(np.unique(some)), is_static=False))
    return tuple(samples)


def is_upright(model: MarkerModel, person: PersonPoints) -> np.ndarray:
    """Return in which frames legs and trunk are straight and vertical, shape (frame,), bool."""
    names = model.keypoints
    if not {"left_ankle", "right_ankle", "left_shoulder", "right_shoulder"} <= set(names):
        return np.zeros(len(person.usable), dtype=bool)
    at = {name: person.points_m[:, names.index(name)] for name in names}
    upright = person.usable.copy()
    for side in ("left", "right"):
        thigh = at[f"{side}_hip"] - at[f"{side}_knee"]
        shank = at[f"{side}_knee"] - at[f"{side}_ankle"]
        upright &= _angle_deg(thigh, shank) < _STRAIGHT_DEG
        upright &= _angle_deg(thigh, np.array([0.0, 1.0, 0.0])) < _STRAIGHT_DEG
    trunk = at["left_shoulder"] + at["right_shoulder"] - at["left_hip"] - at["right_hip"]
    return upright & (_angle_deg(trunk, np.array([0.0, 1.0, 0.0])) < _UPRIGHT_DEG)


def _angle_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return angles between vectors; NaN where one is missing."""
    cross = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.degrees(np.arctan2(cross, (a * b).sum(axis=-1)))
