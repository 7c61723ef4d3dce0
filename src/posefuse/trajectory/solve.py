"""Trajectory solve: keypoint paths that best explain every view, move smoothly and keep bone lengths.

See docs/methods/trajectory.md.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source, ViewStatus, status_of_views
from posefuse.model.tracks import TrackState
from posefuse.trajectory.ambiguity import find_ambiguous, has_single_views
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.ground_contact import FindContact, GroundContact
from posefuse.trajectory.observations import MeasuredRange, PersonObservations, swapped_pairs
from posefuse.trajectory.path_solver import PathSolver
from posefuse.trajectory.paths import Paths
from posefuse.trajectory.priors import RecordingPriors
from posefuse.trajectory.priors import margin_s as margin_s
from posefuse.trajectory.roughness import Roughness
from posefuse.trajectory.smoothness import Smoothness

_MIN_USED_WEIGHT = 0.5
"""Minimum weight of an observation that a point uses."""

_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def solve(
    measured_range: MeasuredRange,
    recording_priors: RecordingPriors,
    options: TrajectoryOptions,
    find_contact: FindContact | None = None,
) -> Layer:
    """Solve the paths of all keypoints over a range of frames jointly.

    Args:
        measured_range: the frames, measured by ``consensus``; for a range of a longer recording, extended by
            :func:`margin_s` on both sides.
        recording_priors: of the recording.
        options: of the solve.
        find_contact: estimates which keypoints rest on the ground; None leaves contact out.

    Returns:
        The solved layer; its source is ``trajectory``, or ``filled`` where no view observes a point.
    """
    bones = Bones.of(measured_range.detections.skeleton)
    people = [
        _solve_person(measured_range, person, bones, recording_priors, options, find_contact)
        for person in range(measured_range.tracks.detection.shape[1])
    ]
    if not people:
        return measured_range.layer
    return Layer(*(np.stack(arrays, axis=1) for arrays in zip(*people, strict=True)))


def estimate_roughness(
    recording_priors: RecordingPriors, parts: Iterable[MeasuredRange], options: TrajectoryOptions
) -> RecordingPriors:
    """Return the priors with the roughness of the motion, so that all ranges of a recording use the same.

    Args:
        recording_priors: of the recording.
        parts: ranges of its frames, those the priors were estimated from.
        options: of the solve.
    """
    roughness_of: dict[int, Roughness] = {}
    for part in parts:
        bones = Bones.of(part.detections.skeleton)
        for person in range(len(recording_priors.density)):
            person_priors = recording_priors.of(person, part.noise.spread)
            if not np.isfinite(person_priors.density).all():
                continue
            observed = PersonObservations.of(part, person)
            if not observed.has_points:
                continue
            solver = PathSolver(observed, Smoothness.of(options.prior, observed.time_s), bones, options)
            if solver.can_estimate_roughness(person_priors):
                roughness = solver.roughness(solver.smooth(person_priors), person_priors)
                roughness_of[person] = roughness_of[person] + roughness if person in roughness_of else roughness
    variance_m2 = recording_priors.roughness_m2.copy()
    for person, roughness in roughness_of.items():
        variance_m2[person] = roughness.variance_m2
    return replace(recording_priors, roughness_m2=variance_m2)


def _solve_person(
    measured_range: MeasuredRange,
    person: int,
    bones: Bones,
    recording_priors: RecordingPriors,
    options: TrajectoryOptions,
    find_contact: FindContact | None,
) -> tuple[np.ndarray, ...]:
    """Return the layer arrays of one person, without the person axis."""
    absent = np.asarray(measured_range.tracks.state[:])[:, person] == TrackState.ABSENT
    person_priors = recording_priors.of(person, measured_range.noise.spread)
    if absent.all() or not np.isfinite(person_priors.density).all():
        return _unsolved(measured_range, person)
    observed = PersonObservations.of(measured_range, person)
    solver = PathSolver(observed, Smoothness.of(options.prior, observed.time_s), bones, options)

    def contact_of(paths: Paths) -> GroundContact | None:
        assert find_contact is not None
        known = (paths.alive & ~absent)[..., None]
        points_m = np.where(known, paths.paths_m, np.nan)
        return find_contact(person, observed.time_s, points_m, np.where(known[..., None], paths.covariance_m2, np.nan))

    paths = solver.solve(person_priors, contact_of if find_contact else None)
    before = np.asarray(measured_range.layer.status)[:, person].T
    status = point_statuses(paths, before, options.max_sd_share * recording_priors.size_m[person])
    residuals = observed.residuals_px(paths.paths_m)
    is_ambiguous = np.zeros(status.shape, dtype=np.bool_)
    if has_single_views(paths):
        is_ambiguous = find_ambiguous(paths, observed.linear(paths.paths_m)[1], bones, person_priors.length_m)
    is_ambiguous &= (status < PointStatus.NOT_SEEN) & (before >= PointStatus.NOT_SEEN)
    status[is_ambiguous] = PointStatus.UNCERTAIN
    status[:, absent] = PointStatus.ABSENT
    has_point = status < PointStatus.NOT_SEEN
    errors = np.where(has_point[..., None], np.linalg.norm(residuals, axis=-1), np.nan)
    used = paths.weights > _MIN_USED_WEIGHT
    measured = np.asarray(measured_range.layer.view_status)[:, person]
    swapped = swapped_keypoints(measured_range, person, measured)
    view_status = view_statuses(measured.transpose(1, 0, 2), np.isfinite(observed.sigma_px), used, has_point, swapped)
    used_points = used & has_point[..., None]
    with np.errstate(invalid="ignore"):
        mean_error = np.where(used_points, errors, 0.0).sum(axis=-1) / used_points.sum(axis=-1)
    total_covariance = paths.covariance_m2 + paths.persistent_covariance_m2
    covariance = np.stack([total_covariance[..., i, j] for i, j in _UPPER], axis=-1)
    source = np.where(has_point, Source.TRAJECTORY, Source.NONE)
    source[status == PointStatus.FILLED] = Source.FILLED
    arrays = (
        np.where(has_point[..., None], paths.paths_m, np.nan),
        np.where(has_point[..., None], covariance, np.nan),
        status.astype(np.int8),
        source.astype(np.int8),
        np.where(has_point, mean_error, np.nan),
        view_status.astype(np.int8),
        errors.astype(np.float32),
    )
    return tuple(np.ascontiguousarray(np.swapaxes(array, 0, 1)) for array in arrays)


def _unsolved(measured_range: MeasuredRange, person: int) -> tuple[np.ndarray, ...]:
    """Return the measured arrays of a person without priors."""
    layer = measured_range.layer
    names = ("points_m", "covariance_m2", "status", "source", "reprojection_error_px", "view_status", "view_error_px")
    return tuple(np.asarray(getattr(layer, used_status))[:, person] for used_status in names)


def point_statuses(paths: Paths, before: np.ndarray, max_sd_m: float) -> np.ndarray:
    """Return the status of each point, shape (keypoint, frame).

    Args:
        paths: solved paths.
        before: shape (keypoint, frame): status of the measured points, the reason where they are missing.
        max_sd_m: maximum standard deviation of points not measured by two views; NaN disables the limit.
    """
    views = (paths.weights > _MIN_USED_WEIGHT).sum(axis=-1)
    # The views alone leave the depth or the choice of a solution uncertain, whatever other frames add.
    warned = (views > 1) & np.isin(before, (PointStatus.WEAK_GEOMETRY, PointStatus.AMBIGUOUS))
    status = np.where(warned, before, status_of_views(views))
    missing = np.where(before >= PointStatus.NOT_SEEN, before, PointStatus.OUTLIER)
    status = np.where(paths.alive, status, missing)
    total_covariance = paths.covariance_m2 + paths.persistent_covariance_m2
    finite = np.asarray(np.isfinite(total_covariance).all(axis=(-1, -2)) & np.isfinite(paths.paths_m).all(axis=-1))
    # Points measured by two views are always reported; their covariance states the uncertainty.
    judged = finite & ~((views > 1) & (before < PointStatus.NOT_SEEN))
    unknown = ~finite
    unknown[judged] = np.linalg.eigvalsh(paths.covariance_m2[judged])[..., -1] > max_sd_m**2
    unknown &= status < PointStatus.NOT_SEEN
    return np.where(unknown, PointStatus.UNCERTAIN, status)


def view_statuses(
    measured: np.ndarray, valid: np.ndarray, used: np.ndarray, has_point: np.ndarray, swapped: np.ndarray
) -> np.ndarray:
    """Return the contribution of each view, shape (keypoint, frame, view).

    Args:
        measured: shape (keypoint, frame, view): its contribution to the measured point.
        valid: the same shape, bool: whether it has a usable detection.
        used: the same shape, bool: whether the path uses it.
        has_point: shape (keypoint, frame), bool: whether the point has coordinates.
        swapped: shape (keypoint, frame, view), bool: whether left and right were exchanged.
    """
    used_status = np.where(swapped, ViewStatus.USED_SWAPPED, ViewStatus.USED)
    judged = np.where(used, used_status, ViewStatus.OUTLIER)
    judged = np.where(has_point[..., None], judged, ViewStatus.NOT_USED)
    return np.where(valid, judged, measured)


def swapped_keypoints(measured_range: MeasuredRange, person: int, view_status: np.ndarray) -> np.ndarray:
    """Return whether each label was exchanged, shape (keypoint, frame, view); ``view_status`` is (frame, ...)."""
    skeleton = measured_range.detections.skeleton
    frames, keypoints, views = view_status.shape
    out = np.zeros((keypoints, frames, views), dtype=bool)
    swapped = swapped_pairs(skeleton, measured_range.swaps, view_status, person)
    for p, pair in enumerate(skeleton.pair_indices):
        out[pair] = swapped[:, p]
    return out
