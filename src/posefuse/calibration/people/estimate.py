"""Estimate poses, focal lengths, clocks and noise of cameras from people, with their covariance.

It is the joint estimate of :mod:`posefuse.calibration.joint` with other priors: poses are free, and so are focal
lengths, distortions and principal points that are not known. Errors of keypoints that are close to each other are
similar, such as those of eyes, ears and nose; each of n close keypoints therefore counts as one n-th of an observation.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.joint.covariance import design_effect, score_covariance
from posefuse.calibration.joint.equations import Rows, influences, normal_equations
from posefuse.calibration.joint.estimate import JointEstimate, estimate
from posefuse.calibration.joint.known_poses import KnownPoses
from posefuse.calibration.joint.parameters import JointParameters
from posefuse.calibration.joint.prior import Prior
from posefuse.calibration.joint.recording import JointRecording
from posefuse.calibration.joint.reweighted import reweighted
from posefuse.calibration.joint.similar_errors import similarity
from posefuse.calibration.people.agreement import estimate_with_prior
from posefuse.calibration.people.held_out import held_out_errors
from posefuse.calibration.people.joint_recording import NOISE_PER_WIDTH, joint_recording
from posefuse.calibration.people.lens_covariance import OtherLens, principal_points
from posefuse.calibration.people.shared_lenses import (
    SPREADS,
    distortion_prior,
    focal_prior,
    mixed,
    spread_probabilities,
)
from posefuse.calibration.people.views import MatchedViews, ViewTracks
from posefuse.errors import CalibrationError
from posefuse.kernels.calibration.joint import FOCAL, PRINCIPAL, RADIAL
from posefuse.model.cameras import Camera
from posefuse.model.lenses import LensModel
from posefuse.skeleton.skeletons import Skeleton

_PRIOR_SD = np.array([3.0] * 3 + [20.0] * 3 + [1.0, 5e-4, 0.4, 0.25])
"""Standard deviations of changes of the approximate calibration: rad, m, s, s/s, logarithm of a length, coefficient."""
_PRINCIPAL_SD = 0.01
"""Standard deviation of a principal point along each axis around the middle, relative to the longer side of the image.

The root mean squares of the four real recordings of the benchmarks are 0.5, 0.7, 0.9 and 1.3 %.
"""
_KNOWN_LENS_SD = 1e-3, 1e-4, 1e-4, 1e-4
_CLOCKS = slice(6, 8)
_MAX_FOCAL_SD, _MAX_TURN_SD = 0.15, 0.1
"""Largest standard deviations of a usable calibration, of the median camera: logarithm of a length, rad."""
_START_SAMPLES = 100
_NEAR = 0.09
"""Distance within which errors are similar, relative to the longest distance between two keypoints of a person."""


@dataclass(frozen=True, eq=False)
class PeopleEstimate:
    """Hold a calibration from people.

    The world is that of the approximate calibration: its origin, orientation and scale are those that fit the
    approximate poses best. The covariance is in that gauge; clocks are relative to the mean clock.

    Attributes:
        cameras: with their estimated poses and focal lengths.
        offset_s: shape (view,): true time of the timestamp 0, relative to the first view.
        rate: shape (view,): true seconds per second of the timestamps, relative to the first view.
        offset_sd_s: shape (view,): standard deviation of the offset to the first view in the middle of the recording.
        covariance: shape (view, parameter, view, parameter): rotation about the camera's axes in rad, center in m,
            time offset in the middle of the recording in s, drift in s/s, logarithm of the focal length and first
            coefficient of radial distortion, 0 if all lenses are known.
        time_s: shape (sample,): true times of ``points_m``.
        points_m: shape (sample, person, keypoint, 3): NaN where not observed by two views.
        bones_m: (person, first keypoint, second keypoint) to the length of each rigid bone.
        noise_px: shape (view,): noise of detections at full confidence.
        slow_share: share of the noise that persists for seconds.
        held_out_px: shape (view,): median reprojection error of a view's detections by points of the other views, in
            frames that the cameras were not estimated from; NaN where no two other views observe a person.
        columns: shape (person, keypoint), int: column of each keypoint in the joint estimate, -1 without.
        joint: the estimate behind it.
        other: other parameters of the lenses, such as the principal points, whose errors ``covariance`` accounts for;
            None if they are exact.
    """

    cameras: tuple[Camera, ...]
    offset_s: np.ndarray
    rate: np.ndarray
    offset_sd_s: np.ndarray
    covariance: np.ndarray
    time_s: np.ndarray
    points_m: np.ndarray
    bones_m: Mapping[tuple[int, str, str], float]
    noise_px: np.ndarray
    slow_share: float
    held_out_px: np.ndarray
    columns: np.ndarray
    joint: JointEstimate
    other: OtherLens | None = None


def estimate_people(
    matched: MatchedViews, known: KnownPoses | None = None, *, held_out: bool = True, refuse: bool = True
) -> PeopleEstimate:
    """Estimate poses, focal lengths, clocks and noise of all views.

    Args:
        matched: observations with an approximate calibration.
        known: what is known of the poses of its cameras, which are then at the known poses.
        held_out: whether held-out errors are measured, which costs as much as the estimate.
        refuse: whether cameras that people alone do not determine are an error.

    Raises:
        CalibrationError: if no two views observe the same person at the same time, or the people do not determine the
            cameras.
    """
    recording, place = joint_recording(matched)
    off_center = _off_center(matched, known)
    prior, log_focal = _prior(matched, off_center), _unknown_log_focal(matched)
    if known is None:
        prior = focal_prior(prior, log_focal, SPREADS[0])
    rough = estimate(recording, None, _START_SAMPLES, prior, known=known)
    if rough is None:
        raise CalibrationError(
            "No two views observe the same person at the same time. Film people where the images of the cameras "
            "overlap, and check the time offsets."
        )
    recording = replace(recording, sigma=recording.sigma * _crowding(rough.rows, place))
    if known is not None:
        joint, known = estimate_with_prior(recording, rough, prior, known)
    else:
        prior = prior.weighted(_weight(rough))
        joint = _by_people(recording, rough, prior, log_focal)
        if refuse:
            _check_determined(joint, log_focal)
    unknown = np.full(len(matched.views), np.nan)
    errors = held_out_errors(recording, joint, prior, known) if held_out else unknown
    result = _with_principal_points(_result(matched, recording, joint, place, errors), matched, off_center)
    return result if known is None else _with_other_lens(result, known)


def _by_people(recording: JointRecording, rough: JointEstimate, prior: Prior, log_focal: np.ndarray) -> JointEstimate:
    """Return the estimate from the people alone, a mixture if focal lengths of several spreads are probable."""
    joint = _weighted_estimate(recording, rough, prior)
    probability = spread_probabilities(joint, log_focal)
    if probability[0] == 1.0:
        return joint
    estimates = [joint]
    for sd, share in zip(SPREADS[1:], probability[1:], strict=True):
        closer = focal_prior(prior, log_focal, sd)
        estimates.append(_weighted_estimate(recording, estimates[-1], closer) if share > 0.0 else joint)
    return mixed(estimates, probability, recording)


def _check_determined(joint: JointEstimate, log_focal: np.ndarray) -> None:
    """Raise a CalibrationError if the people determine neither focal lengths nor poses."""
    unknown = np.isfinite(log_focal)
    focal_sd = float(np.median(joint.sd[unknown, FOCAL])) if unknown.any() else 0.0
    if focal_sd > _MAX_FOCAL_SD:
        raise CalibrationError(
            "The people do not determine the focal lengths of the cameras: their standard deviation is "
            f"{100 * focal_sd:.0f} %. Give the lenses (`intrinsics`), or film a person who walks through the whole "
            "volume."
        )
    turn_sd = float(np.median(joint.sd[:, :3].max(axis=1)))
    if turn_sd > _MAX_TURN_SD:
        raise CalibrationError(
            "The people do not determine the directions of the cameras: their standard deviation is "
            f"{np.degrees(turn_sd):.0f} degrees. Film a person who walks through the whole volume."
        )


def _weighted_estimate(recording: JointRecording, start: JointEstimate, prior: Prior) -> JointEstimate:
    """Return the estimate with observations weighted by their correlation over time."""
    return reweighted(estimate(recording, start.parameters, prior=prior) or start, recording, prior)


def _weight(rough: JointEstimate) -> np.ndarray:
    """Return the weight of the prior, shape (parameter,): clocks follow from changes, whose errors are independent."""
    size = rough.parameters.size
    own = np.arange(len(rough.names) * size) % size
    kept = np.flatnonzero((own < _CLOCKS.start) | (own >= _CLOCKS.stop))
    weight = np.ones(len(own))
    rows, basis = rough.rows, np.linalg.svd(rough.basis[kept], full_matrices=False)
    curvature = rows.relative_curvature * normal_equations(rows)[0]
    spread = score_covariance(influences(rows), rows, rough.law)
    at = np.ix_(kept, kept)
    weight[kept] = design_effect(basis[0][:, basis[1] > 0.5], curvature[at], spread[at])
    return weight


def _off_center(matched: MatchedViews, known: KnownPoses | None) -> np.ndarray:
    """Return whether each principal point is unknown, shape (view,), bool: no calibration states the lens."""
    unknown = np.array([_is_lens_unknown(view) for view in matched.views])
    if known is None:
        return unknown
    at = np.arange(len(unknown))
    return unknown & (known.precision[at, FOCAL, at, FOCAL] == 0.0)


def _prior(matched: MatchedViews, off_center: np.ndarray) -> Prior:
    """Return the prior of independent views, with parameters of the lens if any is unknown."""
    cameras = [view.camera for view in matched.views]
    principal = np.array([_PRINCIPAL_SD * max(camera.size_px) / camera.matrix[0, 0] for camera in cameras])
    out = np.concatenate([np.tile(_PRIOR_SD, (len(cameras), 1)), np.tile(principal[:, None], 2)], axis=1)
    out[~off_center, PRINCIPAL:] = _KNOWN_LENS_SD[2:]
    known = np.array([view.focal_known for view in matched.views])
    out[known, FOCAL:] = _KNOWN_LENS_SD
    unknown = np.array([_is_lens_unknown(view) for view in matched.views])
    out[~unknown, RADIAL] = _KNOWN_LENS_SD[1]
    return Prior.of_sds(out[:, :FOCAL]) if known.all() else distortion_prior(Prior.of_sds(out), unknown)


def _unknown_log_focal(matched: MatchedViews) -> np.ndarray:
    """Return the logarithm of the approximate focal lengths relative to the image size; NaN where they are known."""
    cameras = [view.camera for view in matched.views]
    relative = np.log([camera.matrix[0, 0] / max(camera.size_px) for camera in cameras])
    return np.where([view.focal_known for view in matched.views], np.nan, relative)


def _crowding(rows: Rows, place: np.ndarray) -> np.ndarray:
    """Return the factors of the noise that account for similar errors of close keypoints, shape (column,)."""
    out = np.ones(rows.points_m.shape[1])
    for columns in place:
        chosen = columns[columns >= 0]
        similar = similarity(rows.points_m[:, chosen], _NEAR)
        out[chosen] = np.sqrt(np.maximum(similar.sum(axis=1), 1.0))
    return out


def _result(
    matched: MatchedViews, recording: JointRecording, joint: JointEstimate, place: np.ndarray, held_out: np.ndarray
) -> PeopleEstimate:
    """Return the result in the units of the user."""
    views, parameters = matched.views, joint.parameters
    n, size = len(views), parameters.size
    covariance = np.zeros((n, RADIAL + 1, n, RADIAL + 1))
    common = min(size, RADIAL + 1)
    covariance[:, :common, :, :common] = joint.covariance.reshape(n, size, n, size)[:, :common, :, :common]
    offset_s, rate = _clocks(matched, joint)
    clocks = covariance[:, 6, :, 6]
    difference = np.diag(clocks) + clocks[0, 0] - 2.0 * clocks[0]
    columns = np.where(place >= 0, place, 0)
    points = np.where((place >= 0)[..., None], joint.rows.points_m[:, columns], np.nan)
    wide = np.array([NOISE_PER_WIDTH * max(view.camera.size_px) for view in views])
    focal = np.array([view.camera.matrix[0, 0] for view in views])
    if parameters.log_focal is not None:
        focal = focal * np.exp(parameters.log_focal)
    return PeopleEstimate(
        cameras=tuple(_camera(view, parameters, v) for v, view in enumerate(views)),
        offset_s=offset_s,
        rate=rate,
        offset_sd_s=np.sqrt(np.maximum(difference, 0.0)),
        covariance=covariance,
        time_s=recording.moments_s[joint.rows.frames],
        points_m=points,
        bones_m=_bones(matched.skeleton, points),
        noise_px=wide * joint.noise_scale,
        slow_share=joint.law.slow,
        held_out_px=held_out * focal,
        columns=place,
        joint=joint,
    )


def _with_principal_points(result: PeopleEstimate, matched: MatchedViews, unknown: np.ndarray) -> PeopleEstimate:
    """Return the result with the estimated principal points of unknown lenses."""
    principal = result.joint.parameters.principal
    if principal is None or not unknown.any():
        return result
    focal, cameras = np.array([view.camera.matrix[0, 0] for view in matched.views]), []
    for v, camera in enumerate(result.cameras):
        matrix = np.array(camera.matrix)
        matrix[:2, 2] += unknown[v] * focal[v] * principal[v]
        cameras.append(replace(camera, matrix=matrix))
    other = principal_points(result.joint.covariance, focal, unknown)
    return replace(result, cameras=tuple(cameras), other=other)


def _with_other_lens(result: PeopleEstimate, known: KnownPoses) -> PeopleEstimate:
    """Return the result with the errors of parameters of the lenses that it holds fixed."""
    n, size = len(result.cameras), result.joint.parameters.size
    common = min(size, RADIAL + 1)
    changes, follow = np.zeros((n, size, known.other.shape[2])), np.zeros_like(known.other)
    changes[:, :common] = known.other[:, :common]
    changes = (result.joint.projection @ changes.reshape(n * size, -1)).reshape(changes.shape)
    follow[:, :common] = changes[:, :common]
    other = OtherLens(follow, known.other_covariance, known.other_parameters)
    covariance = result.covariance + other.spread()
    return replace(result, covariance=covariance, other=other if result.other is None else result.other + other)


def _is_lens_unknown(view: ViewTracks) -> bool:
    """Return whether the distortion of a view is estimated, as its focal length is."""
    return not view.focal_known and view.camera.lens is LensModel.PINHOLE


def _camera(tracks: ViewTracks, parameters: JointParameters, view: int) -> Camera:
    """Return a camera with its estimated pose and lens."""
    camera = tracks.camera
    pose, matrix = np.eye(4), np.array(camera.matrix)
    pose[:3, :3] = parameters.rotation[view]
    pose[:3, 3] = -parameters.rotation[view] @ parameters.center_m[view]
    if parameters.log_focal is not None:
        matrix[:2, :2] *= np.exp(parameters.log_focal[view])
    camera = replace(camera, matrix=matrix, camera_from_world=pose)
    if parameters.radial is None or not _is_lens_unknown(tracks):
        return camera
    return replace(camera, lens=LensModel.BROWN, distortion=(float(parameters.radial[view]), 0.0, 0.0, 0.0, 0.0))


def _clocks(matched: MatchedViews, joint: JointEstimate) -> tuple[np.ndarray, np.ndarray]:
    """Return the true times of timestamp 0 and the rates of all clocks, relative to the first view."""
    offset, drift = joint.parameters.offset_s, joint.parameters.drift
    start_s = matched.offset_s * (1.0 + drift) + offset - drift * joint.middle_s
    rate = matched.rate * (1.0 + drift)
    return (start_s - start_s[0]) / rate[0], rate / rate[0]


def _bones(skeleton: Skeleton, points_m: np.ndarray) -> dict[tuple[int, str, str], float]:
    """Return the median lengths of the rigid bones of each person, the same on both sides."""
    out: dict[tuple[int, str, str], float] = {}
    for person in range(points_m.shape[1]):
        for names in skeleton.rigid:
            a, b = (skeleton.index(name) for name in names)
            sides = ((a, b), (int(skeleton.mirror[a]), int(skeleton.mirror[b])))
            lengths = np.concatenate(
                [np.linalg.norm(points_m[:, person, i] - points_m[:, person, j], axis=-1) for i, j in sides]
            )
            if np.isfinite(lengths).any():
                for i, j in sides:
                    out[person, skeleton.keypoints[i], skeleton.keypoints[j]] = float(np.nanmedian(lengths))
    return out
