"""One solve over the whole recording: the paths that best explain every view, move smoothly and keep their bones.

See docs/methods.md, "One solve over the whole recording".
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.label_swaps import Swaps
from posefuse.model.noise import NoiseModel
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.tracks import Tracks, TrackState
from posefuse.trajectory.ambiguity import ambiguous
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.observed import Measured, Observed, swapped_pairs
from posefuse.trajectory.paths import Paths, Solver
from posefuse.trajectory.priors import Laws
from posefuse.trajectory.priors import margin_s as margin_s
from posefuse.trajectory.roughness import Roughness
from posefuse.trajectory.smoothness import Smoothness

_COUNTS = 0.5
"""An observation that counts less is not one the point rests on."""

_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def solve(
    rig: CameraRig,
    detections: Detections,
    tracks: Tracks,
    layer: Layer,
    swaps: Swaps | None,
    noise: NoiseModel,
    laws: Laws,
    options: TrajectoryOptions,
) -> Layer:
    """Solve every keypoint's path over a range of frames, as one.

    Args:
        rig: the cameras, in the order of the detections' views.
        detections: in memory; of a range of a longer recording, :func:`margin_s` more on both sides.
        tracks: whose detection is whose, of the same frames.
        layer: the measured layer of the same frames, by ``consensus``: where to begin.
        swaps: which views took left for right, or None where labels are believed.
        noise: of the detections.
        laws: of the recording.
        options: of the solve.

    Returns:
        The solved layer, its source ``trajectory``, or ``filled`` where no view sees a point.
    """
    given = Measured(rig, detections, tracks, layer, swaps, noise)
    bones = Bones.of(detections.skeleton)
    people = [_person(given, person, bones, laws, options) for person in range(tracks.detection.shape[1])]
    if not people:
        return layer
    return Layer(*(np.stack(arrays, axis=1) for arrays in zip(*people, strict=True)))


def with_roughness(laws: Laws, parts: Iterable[Measured], options: TrajectoryOptions) -> Laws:
    """The laws with what the motion is beside its paths, so that all ranges of a recording hold it for the same.

    Args:
        laws: of the recording.
        parts: ranges of its frames, those the laws were learned from.
        options: of the solve.
    """
    found: dict[int, Roughness] = {}
    for part in parts:
        bones = Bones.of(part.detections.skeleton)
        for person in range(len(laws.density)):
            law = laws.of(person, part.noise.spread)
            if not np.isfinite(law.density).all():
                continue
            observed = Observed.of(part, person)
            solver = Solver(observed, Smoothness.of(options.prior, observed.time_s), bones, options)
            if solver.tells_roughness(law):
                told = solver.roughness(solver.smooth(law), law)
                found[person] = found[person] + told if person in found else told
    variance_m2 = laws.roughness_m2.copy()
    for person, told in found.items():
        variance_m2[person] = told.variance_m2
    return replace(laws, roughness_m2=variance_m2)


def _person(
    given: Measured, person: int, bones: Bones, laws: Laws, options: TrajectoryOptions
) -> tuple[np.ndarray, ...]:
    """The layer's arrays of one person, without their axis."""
    observed = Observed.of(given, person)
    law = laws.of(person, given.noise.spread)
    if not np.isfinite(law.density).all():
        return _nobody(given, person)
    solver = Solver(observed, Smoothness.of(options.prior, observed.time_s), bones, options)
    paths = solver.solve(law)
    absent = np.asarray(given.tracks.state[:])[:, person] == TrackState.ABSENT
    before = np.asarray(given.layer.status)[:, person].T
    status = judge(paths, before, options.max_sd_share * laws.size_m[person])
    residuals, jacobians = observed.linear(paths.paths_m)
    doubted = ambiguous(paths, jacobians, bones, law.length_m)
    doubted &= (status < PointStatus.NOT_SEEN) & (before >= PointStatus.NOT_SEEN)
    status[doubted] = PointStatus.UNCERTAIN
    status[:, absent] = PointStatus.ABSENT
    there = status < PointStatus.NOT_SEEN
    errors = np.where(there[..., None], np.linalg.norm(residuals, axis=-1), np.nan)
    used = paths.weights > _COUNTS
    measured = np.asarray(given.layer.view_status)[:, person]
    swapped = swapped_keypoints(given, person, measured)
    view_status = judge_views(measured.transpose(1, 0, 2), np.isfinite(observed.sigma_px), used, there, swapped)
    counted = used & there[..., None]
    with np.errstate(invalid="ignore"):
        mean = np.where(counted, errors, 0.0).sum(axis=-1) / counted.sum(axis=-1)
    both = paths.covariance_m2 + paths.lasting_m2
    covariance = np.stack([both[..., i, j] for i, j in _UPPER], axis=-1)
    source = np.where(there, Source.TRAJECTORY, Source.NONE)
    source[status == PointStatus.FILLED] = Source.FILLED
    by_frame = (
        np.where(there[..., None], paths.paths_m, np.nan),
        np.where(there[..., None], covariance, np.nan),
        status.astype(np.int8),
        source.astype(np.int8),
        np.where(there, mean, np.nan),
        view_status.astype(np.int8),
        errors.astype(np.float32),
    )
    return tuple(np.ascontiguousarray(np.swapaxes(array, 0, 1)) for array in by_frame)


def _nobody(given: Measured, person: int) -> tuple[np.ndarray, ...]:
    """Of somebody of whom nothing is known: as measured, that is not at all."""
    layer = given.layer
    names = ("points_m", "covariance_m2", "status", "source", "reprojection_error_px", "view_status", "view_error_px")
    return tuple(np.asarray(getattr(layer, name))[:, person] for name in names)


def judge(paths: Paths, before: np.ndarray, most_sd_m: float) -> np.ndarray:
    """Shape (keypoint, frame): what became of each point.

    Args:
        paths: solved.
        before: shape (keypoint, frame): status of the measured points, why they are missing.
        most_sd_m: points known worse are not given; NaN gives all.
    """
    views = (paths.weights > _COUNTS).sum(axis=-1)
    status = np.select(
        [views > 2, views == 2, views == 1],
        [PointStatus.OK, PointStatus.TWO_VIEWS, PointStatus.HELD],
        PointStatus.FILLED,
    )
    missing = np.where(before >= PointStatus.NOT_SEEN, before, PointStatus.OUTLIER)
    status = np.where(paths.alive, status, missing)
    both = paths.covariance_m2 + paths.lasting_m2
    finite = np.asarray(np.isfinite(both).all(axis=(-1, -2)) & np.isfinite(paths.paths_m).all(axis=-1))
    passing = np.where(finite[..., None, None], paths.covariance_m2, 0.0)
    variance = np.linalg.eigvalsh(passing)[..., -1]
    # What views measured together is given however badly they did: its covariance says so.
    measured = (views > 1) & (before < PointStatus.NOT_SEEN)
    unknown = ~finite | (~measured & (variance > most_sd_m**2))
    unknown &= status < PointStatus.NOT_SEEN
    return np.where(unknown, PointStatus.UNCERTAIN, status)


def judge_views(
    measured: np.ndarray, valid: np.ndarray, used: np.ndarray, there: np.ndarray, swapped: np.ndarray
) -> np.ndarray:
    """Shape (keypoint, frame, view): what each view contributed.

    Args:
        measured: shape (keypoint, frame, view): what it contributed to the measured point.
        valid: the same shape, bool: whether it has a detection that could count.
        used: the same shape, bool: whether it did.
        there: shape (keypoint, frame), bool: whether the point has coordinates.
        swapped: shape (keypoint, frame, view), bool: whether left and right were exchanged.
    """
    name = np.where(swapped, ViewStatus.USED_SWAPPED, ViewStatus.USED)
    judged = np.where(used, name, ViewStatus.OUTLIER)
    judged = np.where(there[..., None], judged, ViewStatus.NOT_USED)
    return np.where(valid, judged, measured)


def swapped_keypoints(given: Measured, person: int, view_status: np.ndarray) -> np.ndarray:
    """Shape (keypoint, frame, view), bool: whether a keypoint's label was exchanged; view_status is (frame, ...)."""
    skeleton = given.detections.skeleton
    frames, keypoints, views = view_status.shape
    out = np.zeros((keypoints, frames, views), dtype=bool)
    swapped = swapped_pairs(skeleton, given.swaps, view_status, person)
    for p, pair in enumerate(skeleton.pair_indices):
        out[pair] = swapped[:, p]
    return out
