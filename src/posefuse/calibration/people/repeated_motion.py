"""Check that the time offset of each view is not confounded with its pose.

What people do after some seconds is the same, moved rigidly, if they walk straight (or along a circle) at constant
speed. A view that starts that much later, from a place that is moved as much, then observes the same.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.people.ambiguity import costs_function
from posefuse.calibration.people.assemble import Assembly, free_parameters, readjust
from posefuse.calibration.people.bearings import Bearings
from posefuse.calibration.people.bodies import BodySamples, Bones, observe_body
from posefuse.calibration.people.likelihood import SIGNIFICANT, advantage
from posefuse.calibration.people.rigs import People, Rig
from posefuse.calibration.people.sample_sides import with_corrected_sides
from posefuse.calibration.people.time_search import GRID_S
from posefuse.errors import CalibrationError
from posefuse.kernels.calibration.ray_points import triangulate_rays
from posefuse.model.rotations import closest_rotation

_BEYOND, _NEIGHBORS = 3, 2
"""Steps beyond the largest difference of time, and to both sides, at which a minimum is compared."""
_MOST_REPETITIONS = 2
_SAME_POSE = 0.6
"""Largest median distance of points from their earlier place, in mean lengths of bones.

Straight walks have 0.2 to 0.5 in simulations, other motion 0.8 to 2.
"""
_MIN_PATH = 2.0
"""Least distance that people move meanwhile, relative to the former; otherwise another place makes no difference."""
_MIN_SAMPLES, _MIN_KEYPOINTS, _MIN_POINTS = 8, 4, 30
_MIN_SHARE = 0.4
_ROUNDS, _ALIGNMENTS = 2, 5
_TWO = 2


@dataclass(frozen=True, eq=False)
class Repetition:
    """Hold a rigid motion that people repeat.

    Attributes:
        after_s: time after which they repeat it.
        rotation: shape (3, 3).
        shift: shape (3,): ``rotation x + shift`` is the earlier place of a point.
        distance: median distance of points from their earlier place.
        path: median distance that points move meanwhile.
    """

    after_s: float
    rotation: np.ndarray
    shift: np.ndarray
    distance: float
    path: float


def check_repeated_motion(
    views: Sequence[Bearings], table: People, bones: Bones, focal_known: np.ndarray, rig: Rig, max_offset_s: float
) -> None:
    """Check that no other time offset of a view, with another pose, explains the people about as well.

    Args:
        views: directions of all views, at their true rates.
        table: index of each person in every view, -1 where a view does not observe it.
        bones: bones of the skeleton.
        focal_known: shape (view,), bool.
        rig: the rig.
        max_offset_s: bound of the time offsets.

    Raises:
        CalibrationError: if another offset is not significantly less probable.
    """
    assembly = rig.assembly
    chosen = list(assembly.views)
    motion = _Motion(
        [views[v] for v in chosen],
        [[person[v] for v in chosen] for person in table],
        rig.offset_s[chosen],
        assembly,
        bones,
    )
    free = free_parameters(focal_known[chosen], True)
    for place in range(len(chosen)):
        for repetition in motion.repetitions(place, max_offset_s):
            if motion.is_confounded(place, repetition, free):
                name, start_s = motion.views[place].name, motion.start_s(place)
                raise CalibrationError(
                    f"The people do not determine the time offset of {name}: they walk steadily, and offsets of "
                    f"{start_s:.1f} and {start_s + repetition.after_s:.1f} s, with other poses, explain their motion "
                    "about equally well. Film a person who turns around and stops, or if the cameras are synchronized, "
                    "state it (`max_offset_s=0`)."
                )


@dataclass(frozen=True, eq=False)
class _Motion:
    """Hold what the views of an assembly observe over time."""

    views: Sequence[Bearings]
    people: People
    offset_s: np.ndarray
    assembly: Assembly
    bones: Bones

    def start_s(self, place: int) -> float:
        """Return the time offset of a view relative to the first, or to the second for the first."""
        return float(self.offset_s[place] - self.offset_s[int(place == 0)])

    def repetitions(self, place: int, max_offset_s: float) -> list[Repetition]:
        """Return the clearest rigid motions that people repeat while a view observes them."""
        half = round(max_offset_s / GRID_S)
        found = {k: self._repetition(place, GRID_S * k) for k in range(-half - _BEYOND, half + _BEYOND + 1)}
        minima = [
            each
            for k, each in found.items()
            if each is not None
            and abs(k) > _NEIGHBORS
            and each.distance < min(self._largest_distance(), each.path / _MIN_PATH)
            and self._is_allowed(place, each.after_s, max_offset_s)
            and all(each.distance <= other.distance for other in _neighbors(found, k))
        ]
        return sorted(minima, key=lambda each: each.distance)[:_MOST_REPETITIONS]

    def _largest_distance(self) -> float:
        """Return the distance of points from their earlier place up to which people have the same pose."""
        log_lengths = self.assembly.state.log_lengths
        return _SAME_POSE * float(np.exp(log_lengths.mean())) if log_lengths.size else np.inf

    def is_confounded(self, place: int, repetition: Repetition, free: np.ndarray) -> bool:
        """Return whether a view may as well be at another place, and later by the time of a repetition."""
        samples, own = self.assembly.samples, self.assembly
        later = self._with_later_view(place, repetition.after_s)
        used = _observes(later, place) & _observes(samples, place)
        if used.sum() < max(_MIN_SAMPLES, _MIN_SHARE * _observes(samples, place).sum()):
            return False
        costs_of = costs_function(own)
        costs = costs_of(samples, self.bones, own.state)[used]
        shifted = later.select(used)
        rotations, centers = own.state.rotations.copy(), own.state.centers.copy()
        rotations[place] = rotations[place] @ repetition.rotation.T
        centers[place] = repetition.rotation @ centers[place] + repetition.shift
        other = replace(own, state=replace(own.state, rotations=rotations, centers=centers))
        for _ in range(_ROUNDS):
            other = readjust(other, shifted, self.bones, free)
        theirs = costs_of(other.samples, self.bones, other.state)
        # A single stop or turn may decide.
        return advantage(costs, theirs, None) < SIGNIFICANT

    def _is_allowed(self, place: int, after_s: float, max_offset_s: float) -> bool:
        """Return whether all time offsets stay within their bound if one view starts later."""
        moved = self.offset_s.copy()
        moved[place] += after_s
        return float(np.ptp(moved)) <= max_offset_s + 0.5 * GRID_S

    def _repetition(self, place: int, after_s: float) -> Repetition | None:
        """Return how people move within a time, rigidly; None if too few moments show it."""
        samples = self.assembly.samples
        later = self._with_times(samples.time_s + after_s)
        used = _observes(samples, place) & _observes(later, place)
        if used.sum() < max(_MIN_SAMPLES, _MIN_SHARE * _observes(samples, place).sum()):
            return None
        before, after = self.assembly.state.points[used], self._points(later.select(used))
        known = np.isfinite(before[..., 0]) & np.isfinite(after[..., 0])
        if known.sum() < _MIN_POINTS:
            return None
        path = float(np.median(np.linalg.norm(after[known] - before[known], axis=1)))
        return Repetition(after_s, *_rigid_motion(after[known], before[known]), path)

    def _points(self, samples: BodySamples) -> np.ndarray:
        """Return triangulated points, shape (sample, keypoint, 3)."""
        rotations, centers = self.assembly.state.rotations, self.assembly.state.centers
        labeled, _ = with_corrected_sides(samples, rotations, centers)
        points = np.empty((*labeled.observed.shape[:1], labeled.observed.shape[2], 3))
        triangulate_rays(rotations, centers, labeled.observed, points)
        return points

    def _with_times(self, time_s: np.ndarray) -> BodySamples:
        """Return what the views observe of the person of each sample at other times."""
        samples = self.assembly.samples
        observed = np.full_like(samples.observed, np.nan)
        for p, person in enumerate(self.people):
            at = samples.person == p
            observed[at] = observe_body(self.views, person, time_s[at, None] - self.offset_s)
        return replace(samples, time_s=time_s, observed=observed)

    def _with_later_view(self, place: int, after_s: float) -> BodySamples:
        """Return the samples with later observations of one view."""
        observed = self.assembly.samples.observed.copy()
        later = self._with_times(self.assembly.samples.time_s + after_s)
        observed[:, place] = later.observed[:, place]
        return replace(self.assembly.samples, observed=observed)


def _neighbors(found: dict[int, Repetition | None], k: int) -> Iterator[Repetition]:
    """Yield the repetitions at near times."""
    for other in range(k - _NEIGHBORS, k + _NEIGHBORS + 1):
        each = found.get(other)
        if each is not None:
            yield each


def _observes(samples: BodySamples, place: int) -> np.ndarray:
    """Return the samples that a view and another one observe, shape (sample,), bool."""
    enough = np.isfinite(samples.observed[..., 0]).sum(axis=2) >= _MIN_KEYPOINTS
    return enough[:, place] & (enough.sum(axis=1) >= _TWO)


def _rigid_motion(points: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the rotation and the shift that move points to others (Kabsch 1976), robust, and the median distance."""
    weight, rotation, shift, distance = np.ones(len(points)), np.eye(3), np.zeros(3), np.zeros(len(points))
    for _ in range(_ALIGNMENTS):
        share = (weight / weight.sum())[:, None]
        from_mean, to_mean = (share * points).sum(axis=0), (share * target).sum(axis=0)
        rotation = closest_rotation((share * (target - to_mean)).T @ (points - from_mean))
        shift = to_mean - rotation @ from_mean
        distance = np.linalg.norm(points @ rotation.T + shift - target, axis=1)
        weight = 1.0 / (1.0 + np.square(distance / max(float(np.median(distance)), 1e-12)))
    return rotation, shift, float(np.median(distance))
