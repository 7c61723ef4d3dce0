"""A result of many people beside its truth, on the same frames and keypoints."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.errors import ResultError, choices
from posefuse.evaluation.accuracy import Truth, interpolated
from posefuse.evaluation.matching import is_here
from posefuse.model.cameras import UpAxis
from posefuse.model.reconstruction import Reconstruction, unpack_covariance
from posefuse.model.status import PointStatus, Source
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import Skeleton


@dataclass(frozen=True, eq=False)
class Bodies:
    """People with all the keypoints they have.

    Attributes:
        skeleton: of the keypoint axis.
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
    """

    skeleton: Skeleton
    points_m: np.ndarray


@dataclass(frozen=True, eq=False)
class PeoplePoints:
    """A result and its truth on the same frames and keypoints.

    Attributes:
        skeleton: of the keypoint axes.
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
        truth_m: shape (frame, truth, keypoint, 3), NaN where missing, in the same world.
        time_s: shape (frame,), increasing, or None where unknown.
        covariance_m2: shape (frame, person, keypoint, 3, 3), NaN where unknown, or None where there is none at all.
        person_ids: names of the result's people; by default numbered.
        truth_ids: names of the truth's people; by default numbered.
        up_axis: of the world, None where unknown.
        layer: of the result.
        matched_by: how frames were put together.
        whole: result and truth with all keypoints each has, of the same frames and people: parts need the nose and ears
            of the one and the head of the other. By default the shared ones.
        scale: how large bodies are next to an adult human.

    Raises:
        ResultError: where the arrays do not fit each other.
    """

    skeleton: Skeleton
    points_m: np.ndarray
    truth_m: np.ndarray
    time_s: np.ndarray | None = None
    covariance_m2: np.ndarray | None = None
    person_ids: tuple[str, ...] = ()
    truth_ids: tuple[str, ...] = ()
    up_axis: UpAxis | None = None
    layer: str = "points"
    matched_by: str = "order"
    whole: tuple[Bodies, Bodies] | None = None
    scale: float = 1.0

    def __post_init__(self) -> None:
        frames, tail = len(self.points_m), (len(self.skeleton), 3)
        for name, points in (("points_m", self.points_m), ("truth_m", self.truth_m)):
            if points.ndim != 4 or len(points) != frames or points.shape[2:] != tail:
                raise ResultError(
                    f"{name}: expected (frame, person, keypoint, 3) = ({frames}, any, {tail[0]}, 3), "
                    f"got {points.shape}."
                )
        if self.covariance_m2 is not None and self.covariance_m2.shape != (*self.points_m.shape, 3):
            raise ResultError(
                f"covariance_m2: expected {(*self.points_m.shape, 3)}, a 3 x 3 matrix a point, "
                f"got {self.covariance_m2.shape}."
            )
        if self.time_s is not None and not (len(self.time_s) == frames and np.all(np.diff(self.time_s) > 0)):
            raise ResultError(f"time_s: expected {frames} increasing times; leave it out where they are not known.")
        for name, points in (("person_ids", self.points_m), ("truth_ids", self.truth_m)):
            ids = getattr(self, name) or tuple(f"person_{i + 1}" for i in range(points.shape[1]))
            if len(ids) != points.shape[1]:
                raise ResultError(f"{name}: {len(ids)} names for {points.shape[1]} people.")
            object.__setattr__(self, name, tuple(ids))


def only_in_states(result: Reconstruction, states: Collection[TrackState]) -> Reconstruction:
    """The same result without points of people who are not in one of these states, such as lost ones' predictions.

    Raises:
        ResultError: if the result does not say who is in which state.
    """
    if result.tracks is None:
        raise ResultError("This result has no tracks, so nobody in it is tentative, active or lost: leave states out.")
    out = ~np.isin(np.asarray(result.tracks.state[:]), [int(state) for state in states])
    layers = {}
    for name, layer in result.layers.items():
        points, covariance = np.array(layer.points_m[:]), np.array(layer.covariance_m2[:])
        status, source = np.array(layer.status[:]), np.array(layer.source[:])
        points[out], covariance[out], status[out], source[out] = np.nan, np.nan, PointStatus.ABSENT, Source.NONE
        layers[name] = replace(layer, points_m=points, covariance_m2=covariance, status=status, source=source)
    return replace(result, layers=layers)


def people_points(result: Reconstruction, truth: Reconstruction) -> PeoplePoints:
    """A result and another reconstruction, such as the truth of a simulation, on the frames both have.

    Frames are put together by their numbers, or, where the rates differ, by time: the truth is interpolated linearly.
    Keypoints are the truth's, those the result lacks left out; the truth's derived ones are made of the result's.

    Args:
        result: in metres; ``options.layer`` or the best layer is compared.
        truth: in the same world.

    Raises:
        ResultError: if they share no frame or no keypoint.
    """
    sources = result.skeleton.sources_of(truth.skeleton)
    if not sources:
        raise ResultError(f"Result ({result.skeleton.name}) and truth ({truth.skeleton.name}) share no keypoint names.")
    frames, whole_m, matched_by = _at_frames_of(result, truth)
    skeleton = sub_skeleton(truth.skeleton, tuple(sources))
    return _joined(result, skeleton, frames, Bodies(truth.skeleton, whole_m), truth.person_ids, matched_by)


def _joined(
    result: Reconstruction,
    skeleton: Skeleton,
    frames: np.ndarray,
    truth: Bodies,
    truth_ids: Sequence[str],
    matched_by: str,
) -> PeoplePoints:
    """Some frames of a result, with its keypoints as ``skeleton`` has them, beside the truth of these frames."""
    if result.unit != "m":
        raise ResultError(f"The result is in {result.unit} (one camera's image plane); there is no comparing it in 3D.")
    name, layer = result.best_layer(result.options.layer)
    sources = result.skeleton.sources_of(skeleton)
    covariance = unpack_covariance(np.asarray(layer.covariance_m2[:])[frames])
    points = np.asarray(layer.points_m[:])[frames]
    time_s = result.time_s[frames]
    timed = bool(np.isfinite(time_s).all() and np.all(np.diff(time_s) > 0))
    return PeoplePoints(
        skeleton=skeleton,
        points_m=_derived(points, result.skeleton, sources),
        truth_m=truth.points_m[:, :, [truth.skeleton.index(keypoint) for keypoint in skeleton.keypoints]],
        time_s=time_s if timed else None,
        covariance_m2=_undivided(covariance, result.skeleton, sources) if np.isfinite(covariance).any() else None,
        person_ids=result.person_ids,
        truth_ids=tuple(truth_ids),
        up_axis=result.rig.up_axis,
        layer=name,
        matched_by=matched_by,
        whole=(Bodies(result.skeleton, points), truth),
        scale=_scale(truth.skeleton, result.skeleton),
    )


def _scale(*skeletons: Skeleton) -> float:
    """Of the first of them whose tree knows how large a body is."""
    return next((skeleton.tree.scale for skeleton in skeletons if skeleton.tree is not None), 1.0)


def with_truths(result: Reconstruction, truths: Sequence[Truth], names: Sequence[str]) -> PeoplePoints:
    """A result and people whose positions came each from its own file, on the keypoints that all have.

    Args:
        result: in metres; ``options.layer`` or the best layer is compared.
        truths: one a person, of the result's frames.
        names: of the people.

    Raises:
        ResultError: if they have no keypoint in common.
    """
    shared = tuple(name for name in result.skeleton.keypoints if all(name in truth.keypoints for truth in truths))
    if not truths or not shared:
        raise ResultError(f"The truth's {len(truths)} people ({choices(names)}) have no keypoint in common.")
    columns = [[truth.keypoints.index(name) for name in shared] for truth in truths]
    known = np.stack([truth.points_m[:, c] for truth, c in zip(truths, columns, strict=True)], axis=1)
    covered = np.flatnonzero(is_here(known).any(axis=1))
    if not len(covered):
        raise ResultError("Result and truth share no frame; are they of the same recording?")
    skeleton = sub_skeleton(result.skeleton, shared)
    return _joined(result, skeleton, covered, Bodies(skeleton, known[covered]), names, truths[0].matched_by)


def sub_skeleton(skeleton: Skeleton, keypoints: tuple[str, ...]) -> Skeleton:
    """Some of a skeleton's keypoints, in the given order, and the edges between them."""
    edges = tuple((a, b) for a, b in skeleton.edges if a in keypoints and b in keypoints)
    derived = {name: parts for name, parts in skeleton.derived.items() if name in keypoints}
    return Skeleton(skeleton.name, keypoints, edges, derived=derived)


def _derived(points_m: np.ndarray, skeleton: Skeleton, sources: Mapping[str, tuple[str, ...]]) -> np.ndarray:
    """Each keypoint as the mean of its parts, shape (frame, person, keypoint, 3)."""
    parts = [[skeleton.index(part) for part in names] for names in sources.values()]
    return np.stack([points_m[:, :, columns].mean(axis=2) for columns in parts], axis=2)


def _undivided(covariance_m2: np.ndarray, skeleton: Skeleton, sources: Mapping[str, tuple[str, ...]]) -> np.ndarray:
    """Covariances of keypoints the result has itself; a mean's is not known, its parts being correlated."""
    columns = [skeleton.index(names[0]) for names in sources.values()]
    found = covariance_m2[:, :, columns]
    found[:, :, [len(names) > 1 for names in sources.values()]] = np.nan
    return found


def _at_frames_of(result: Reconstruction, truth: Reconstruction) -> tuple[np.ndarray, np.ndarray, str]:
    """Which of the result's frames the truth covers, its points there, and how they were put together.

    Returns:
        Shape (shared frame,), int64: places in the result; shape (shared frame, truth, keypoint, 3); and words.
    """
    _, layer = truth.best_layer()
    points = np.asarray(layer.points_m[:])
    if result.rate_hz and truth.rate_hz and abs(result.rate_hz / truth.rate_hz - 1.0) > 1e-3:
        inside = np.flatnonzero((result.time_s >= truth.time_s[0]) & (result.time_s <= truth.time_s[-1]))
        if not len(inside):
            raise ResultError("Result and truth share no time; are they of the same recording?")
        flat = interpolated(points.reshape(len(points), -1, 3), truth.time_s, result.time_s[inside])
        return inside, flat.reshape(-1, *points.shape[1:]), "time"
    shared, ours, theirs = np.intersect1d(result.frame_numbers, truth.frame_numbers, return_indices=True)
    if not len(shared):
        raise ResultError("Result and truth share no frame number; are they of the same recording?")
    return ours, points[theirs], "frame number"
