"""Results of several people paired with ground truth, on the same frames and keypoints."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import ResultError, choices
from posefuse.evaluation.accuracy import Truth, interpolated
from posefuse.evaluation.matching import is_here
from posefuse.model.cameras import UpAxis
from posefuse.model.layer_statuses import with_true_statuses
from posefuse.model.reconstruction import Reconstruction, unpack_covariance
from posefuse.model.status import PointStatus
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import Skeleton


@dataclass(frozen=True, eq=False)
class KeypointSet:
    """People with all their keypoints.

    Attributes:
        skeleton: skeleton of the keypoint axis.
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
    """

    skeleton: Skeleton
    points_m: np.ndarray


@checked
@dataclass(frozen=True, eq=False)
class PeoplePoints:
    """A result and its ground truth on the same frames and keypoints.

    Attributes:
        skeleton: skeleton of the keypoint axes.
        points_m: shape (frame, person, keypoint, 3), NaN where missing.
        truth_m: shape (frame, truth, keypoint, 3), NaN where missing, in the same world.
        time_s: shape (frame,), increasing, or None if unknown.
        covariance_m2: shape (frame, person, keypoint, 3, 3), NaN if unknown, or None without covariances.
        person_ids: names of the result's people; default: numbered.
        truth_ids: names of the truth's people; default: numbered.
        up_axis: up axis of the world, None if unknown.
        layer: layer of the result.
        matched_by: how frames were matched.
        whole: result and truth with all their keypoints, which PCP needs; default: the common ones.
        scale: ratio of the body size to that of an adult human.

    Raises:
        ResultError: if the arrays do not match.
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
    whole: tuple[KeypointSet, KeypointSet] | None = None
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
                f"covariance_m2: expected {(*self.points_m.shape, 3)}, one 3 x 3 matrix per point, "
                f"got {self.covariance_m2.shape}."
            )
        if self.time_s is not None and not (len(self.time_s) == frames and np.all(np.diff(self.time_s) > 0)):
            raise ResultError(f"time_s: expected {frames} increasing times; omit it if they are unknown.")
        for name, points in (("person_ids", self.points_m), ("truth_ids", self.truth_m)):
            ids = getattr(self, name) or tuple(f"person_{i + 1}" for i in range(points.shape[1]))
            if len(ids) != points.shape[1]:
                raise ResultError(f"{name}: expected one name for each of {points.shape[1]} people, got {len(ids)}.")
            object.__setattr__(self, name, tuple(ids))


def only_in_states(result: Reconstruction, states: Collection[TrackState]) -> Reconstruction:
    """Return the result without points of people outside the given track states, such as predictions of lost tracks.

    Raises:
        ResultError: if the result has no tracks.
    """
    if result.tracks is None:
        raise ResultError("This result has no tracks and therefore no track states. Omit states.")
    out = ~np.isin(np.asarray(result.tracks.state[:]), [int(state) for state in states])
    layers = {}
    for name, layer in result.layers.items():
        status = np.where(out[..., None], PointStatus.ABSENT, layer.status[:]).astype(np.int8)
        layers[name] = with_true_statuses(replace(layer.frames(0, result.n_frames), status=status))
    return replace(result, layers=layers)


@checked
def people_points(result: Reconstruction, truth: Reconstruction) -> PeoplePoints:
    """Pair a result with another reconstruction, such as the truth of a simulation, on common frames.

    Frames are matched by number, or by time with linear interpolation of the truth if the rates differ. Keypoints are
    those of the truth that the result has or can derive.

    Args:
        result: result in meters; ``options.layer`` or the best layer is compared.
        truth: ground truth in the same world.

    Raises:
        ResultError: if they share no frame or no keypoint.
    """
    sources = result.skeleton.sources_of(truth.skeleton)
    if not sources:
        raise ResultError(f"Result ({result.skeleton.name}) and truth ({truth.skeleton.name}) share no keypoint names.")
    frames, whole_m, matched_by = _at_frames_of(result, truth)
    skeleton = sub_skeleton(truth.skeleton, tuple(sources))
    return _joined(result, skeleton, frames, KeypointSet(truth.skeleton, whole_m), truth.person_ids, matched_by)


def _joined(
    result: Reconstruction,
    skeleton: Skeleton,
    frames: np.ndarray,
    truth: KeypointSet,
    truth_ids: Sequence[str],
    matched_by: str,
) -> PeoplePoints:
    """Pair selected frames of a result, with the keypoints of ``skeleton``, with the truth of these frames."""
    if result.unit != "m":
        raise ResultError(f"The result is in {result.unit} (one camera's image plane) and cannot be compared in 3D.")
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
        whole=(KeypointSet(result.skeleton, points), truth),
        scale=_scale(truth.skeleton, result.skeleton),
    )


def _scale(*skeletons: Skeleton) -> float:
    """Return the scale of the first skeleton with a tree."""
    return next((skeleton.tree.scale for skeleton in skeletons if skeleton.tree is not None), 1.0)


def with_truths(result: Reconstruction, truths: Sequence[Truth], names: Sequence[str]) -> PeoplePoints:
    """Pair a result with people from separate files, on their common keypoints.

    Args:
        result: result in meters; ``options.layer`` or the best layer is compared.
        truths: one per person, on the result's frames.
        names: names of the people.

    Raises:
        ResultError: if they have no common keypoint.
    """
    shared = tuple(name for name in result.skeleton.keypoints if all(name in truth.keypoints for truth in truths))
    if not truths or not shared:
        raise ResultError(f"The truth's {len(truths)} people ({choices(names)}) have no common keypoint.")
    columns = [[truth.keypoints.index(name) for name in shared] for truth in truths]
    known = np.stack([truth.points_m[:, c] for truth, c in zip(truths, columns, strict=True)], axis=1)
    covered = np.flatnonzero(is_here(known).any(axis=1))
    if not len(covered):
        raise ResultError("Result and truth share no frame. Check that they are from the same recording.")
    skeleton = sub_skeleton(result.skeleton, shared)
    return _joined(result, skeleton, covered, KeypointSet(skeleton, known[covered]), names, truths[0].matched_by)


def sub_skeleton(skeleton: Skeleton, keypoints: tuple[str, ...]) -> Skeleton:
    """Return a skeleton with selected keypoints, in the given order, and the edges between them."""
    edges = tuple((a, b) for a, b in skeleton.edges if a in keypoints and b in keypoints)
    derived = {name: parts for name, parts in skeleton.derived.items() if name in keypoints}
    return Skeleton(skeleton.name, keypoints, edges, derived=derived)


def _derived(points_m: np.ndarray, skeleton: Skeleton, sources: Mapping[str, tuple[str, ...]]) -> np.ndarray:
    """Return each keypoint as the mean of its parts, shape (frame, person, keypoint, 3)."""
    parts = [[skeleton.index(part) for part in names] for names in sources.values()]
    return np.stack([points_m[:, :, columns].mean(axis=2) for columns in parts], axis=2)


def _undivided(covariance_m2: np.ndarray, skeleton: Skeleton, sources: Mapping[str, tuple[str, ...]]) -> np.ndarray:
    """Return covariances of direct keypoints; those of derived ones are unknown because their parts are correlated."""
    columns = [skeleton.index(names[0]) for names in sources.values()]
    found = covariance_m2[:, :, columns]
    found[:, :, [len(names) > 1 for names in sources.values()]] = np.nan
    return found


def _at_frames_of(result: Reconstruction, truth: Reconstruction) -> tuple[np.ndarray, np.ndarray, str]:
    """Return the result's frames covered by the truth, the truth's points, and how frames were matched.

    Returns:
        Shape (shared frame,), int64: indices in the result; shape (shared frame, truth, keypoint, 3); and a
        description.
    """
    _, layer = truth.best_layer()
    points = np.asarray(layer.points_m[:])
    if result.rate_hz and truth.rate_hz and abs(result.rate_hz / truth.rate_hz - 1.0) > 1e-3:
        inside = np.flatnonzero((result.time_s >= truth.time_s[0]) & (result.time_s <= truth.time_s[-1]))
        if not len(inside):
            raise ResultError("Result and truth share no time. Check that they are from the same recording.")
        flat = interpolated(points.reshape(len(points), -1, 3), truth.time_s, result.time_s[inside])
        return inside, flat.reshape(-1, *points.shape[1:]), "time"
    shared, ours, theirs = np.intersect1d(result.frame_numbers, truth.frame_numbers, return_indices=True)
    if not len(shared):
        raise ResultError("Result and truth share no frame number. Check that they are from the same recording.")
    return ours, points[theirs], "frame number"
