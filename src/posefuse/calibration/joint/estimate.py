"""Estimate poses, time offsets, clock drifts and noise of all views together, with their covariance.

The estimate is the maximum of a Student-t likelihood. Its covariance is a sandwich: between inverses of the curvature
stands the covariance of the score under errors that are correlated over time (see
:mod:`posefuse.calibration.joint.covariance`). The data do not determine the world coordinates and the common clock:
changes are those in the world that is closest to the calibration, and relative to the mean clock.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.joint.covariance import information, score_covariance
from posefuse.calibration.joint.equations import (
    Rows,
    influences,
    linearize,
    noise_scales,
    normal_equations,
    observed_curvature,
    pretended_information,
)
from posefuse.calibration.joint.known_poses import KnownPoses
from posefuse.calibration.joint.noise_law import NoiseLaw, estimate_law
from posefuse.calibration.joint.parameters import JointParameters, difference
from posefuse.calibration.joint.prior import Prior
from posefuse.calibration.joint.recording import JointRecording
from posefuse.calibration.joint.similar_errors import error_mixing
from posefuse.calibration.joint.velocity_gain import velocity_gain
from posefuse.kernels.calibration.joint import FOCAL, VIEW_PARAMETERS

PRIOR_SD = np.array([0.1] * 3 + [0.5] * 3 + [1.0, 5e-3])
"""Standard deviations of a weak prior in rad, m, s and s/s; keeps parameters finite that the data do not determine."""
LARGEST_SD = np.array([0.1] * 3 + [0.5] * 3 + [0.1, 1e-4, 0.1, 0.1, 0.1, 0.1])
"""Largest standard deviations of changes that count as determined."""
_END_S = 1.1
"""Time at which end effects double the variance of a clock: velocities at the ends are unknown (measured)."""
_MAX_STEPS = 40
_CONVERGED = 0.03
_MAX_CHANGE = np.array([0.1] * 3 + [0.3] * 3 + [0.1, 0.01, 0.1, 0.1, 0.1, 0.1])
_MAX_VALUES = 12_000_000
_MIN_SPACING_S = 0.08
MAX_SAMPLES = 300
_N_SIMILARITY = 7


@dataclass(frozen=True, eq=False)
class JointEstimate:
    """Hold the estimate of all views.

    Attributes:
        names: names of the cameras.
        parameters: poses and clocks, and focal lengths unless these are fixed.
        change: shape (view, parameter): change of each view from the calibration: rotation about its own axes in
            rad, shift of its center in m, time offset in s in the middle of the recording, drift in s/s, and, unless
            lenses are fixed, the logarithm of the focal length, radial distortion, and two of the principal point.
        covariance: shape (view * parameter, view * parameter): of the changes.
        response: shape (view * parameter, view * parameter): errors of the changes by those of the score.
        information: shape (free, free): what the keypoints alone tell about the changes in the basis, without prior.
        evidence_score: shape (free,): ``information`` times the most likely changes.
        basis: shape (view * parameter, free): directions that the data can determine.
        projection: shape (view * parameter,) twice: maps any change to the equivalent one in this world.
        rows: residuals and derivatives at the estimate.
        law: law of the errors.
        middle_s: time in the middle of the samples, at which the offset holds.
    """

    names: tuple[str, ...]
    parameters: JointParameters
    change: np.ndarray
    covariance: np.ndarray
    response: np.ndarray
    information: np.ndarray
    evidence_score: np.ndarray
    basis: np.ndarray
    projection: np.ndarray
    rows: Rows
    law: NoiseLaw
    middle_s: float

    @property
    def sd(self) -> np.ndarray:
        """Return the standard deviations of the changes, shape (view, parameter)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).reshape(self.change.shape)

    @property
    def determined(self) -> np.ndarray:
        """Return which changes the recording determines, shape (view, parameter), bool.

        A time offset needs people who move; a drift that is less certain than the largest one of real clocks says
        nothing.
        """
        return self.sd <= LARGEST_SD[: self.parameters.size]

    @property
    def noise_scale(self) -> np.ndarray:
        """Return the noise of each view as a multiple of the expected noise, shape (view,)."""
        return self.rows.scale


def estimate(
    recording: JointRecording,
    start: JointParameters | None = None,
    max_samples: int = MAX_SAMPLES,
    prior: Prior | np.ndarray | None = None,
    frames: np.ndarray | None = None,
    known: KnownPoses | None = None,
) -> JointEstimate | None:
    """Estimate poses and clocks of all views, or return None without points that two views observe.

    Args:
        recording: tracked keypoints and calibrated poses.
        start: parameters to start from; by default the calibration.
        max_samples: largest number of frames to use.
        prior: prior of the changes, or its standard deviations, shape (view, parameter); by default :data:`PRIOR_SD`.
            With parameters for the logarithm of the focal length, the radial distortion and the principal point, lenses
            are estimated too.
        frames: shape (sample,): frames to use, ascending; by default evenly spaced ones.
        known: what is known of the poses of the recording's cameras in addition; it determines the scale.
    """
    n = recording.n_views
    prior = np.tile(PRIOR_SD, (n, 1)) if prior is None else prior
    prior = with_known_poses(prior if isinstance(prior, Prior) else Prior.of_sds(prior), known)
    least, size = prior.curvature, len(prior.mean) // n
    calibrated = _calibrated(recording, size)
    parameters = start or calibrated
    frames = sample_frames(recording, max_samples) if frames is None else frames
    scale, points = np.ones(n), None
    for step in range(_MAX_STEPS):
        rows = linearize(recording, frames, parameters, scale, points)
        if not rows.seen.any():
            return None
        scale, points = noise_scales(rows), rows.support_m
        if step < 1:
            continue
        normal, score = normal_equations(rows)
        change = difference(calibrated, parameters)
        basis = _gauge(rows, parameters, known)[0]
        whole = rows.relative_curvature * normal - pretended_information(rows) + least
        inverse = basis @ _inverse(basis.T @ whole @ basis, basis.T @ least @ basis) @ basis.T
        delta = inverse @ (score - prior.pull(change.ravel()))
        delta = delta.reshape(n, -1)
        parameters = parameters.changed(delta / max(1.0, float(np.abs(delta / _MAX_CHANGE[:size]).max())))
        sds = np.sqrt(np.maximum(np.diag(inverse), 0.0)).reshape(delta.shape)
        if step > 2 and (np.abs(delta) < _CONVERGED * sds + 1e-9).all():
            break
    return _finish(recording, linearize(recording, frames, parameters, scale, points), parameters, prior, known)


def with_known_poses(prior: Prior, known: KnownPoses | None) -> Prior:
    """Return the prior with what is known of the poses in addition."""
    if known is None:
        return prior
    return replace(prior, precision=prior.precision + known.matrix(len(prior.mean) // len(known.precision)))


def _calibrated(recording: JointRecording, size: int) -> JointParameters:
    """Return the calibrated poses and correct clocks, with or without focal lengths."""
    still = np.zeros(recording.n_views)
    lens = (still, still, np.zeros((recording.n_views, 2))) if size > FOCAL else ()
    return JointParameters(recording.rotation, recording.center_m, still, still, *lens)


def sample_frames(recording: JointRecording, max_samples: int) -> np.ndarray:
    """Return evenly spaced frames, as many as allowed and as fit into memory."""
    n_frames, n_views, n_columns = recording.xy.shape[:3]
    per_sample = n_columns * n_views * 2 * n_views * VIEW_PARAMETERS
    most = int(np.clip(_MAX_VALUES // max(per_sample, 1), 30, min(max_samples, MAX_SAMPLES)))
    stride = max(1, round(_MIN_SPACING_S / recording.period_s), -(-n_frames // most))
    first = np.searchsorted(recording.runs, recording.runs)
    return np.flatnonzero((np.arange(n_frames) - first) % stride == 0)


def _law(rows: Rows, people: np.ndarray | None) -> NoiseLaw:
    """Return the law of the errors from the residuals."""
    shape = rows.points_m.shape[:2]
    scores = np.where(rows.seen[..., None], rows.scores, np.nan).reshape(*shape, rows.n_views * 2)
    left = float(np.mean(1.0 - rows.leverage()[rows.seen])) if rows.seen.any() else 1.0
    absorbed = (rows.n_views * 6 - _N_SIMILARITY) / max(left, 0.1)
    law = estimate_law(scores.reshape(shape[0], -1), rows.time_s, absorbed)
    return law if people is None else replace(law, mixing=error_mixing(rows, people))


def _finish(
    recording: JointRecording, rows: Rows, parameters: JointParameters, prior: Prior, known: KnownPoses | None
) -> JointEstimate:
    """Return the estimate with its covariance."""
    n, law = recording.n_views, _law(rows, recording.people)
    calibrated = _calibrated(recording, parameters.size)
    basis, projection = _gauge(rows, parameters, known)
    rays = influences(rows)
    normal = observed_curvature(rows) - pretended_information(rows) + prior.curvature
    scores = score_covariance(rays, rows, law)
    middle = scores + prior.spread
    spread = basis @ _inverse(basis.T @ normal @ basis, basis.T @ prior.curvature @ basis) @ basis.T
    covariance = spread @ middle @ spread
    times = recording.moments_s[rows.frames]
    inflated = np.ones((n, parameters.size))
    inflated[:, 6:8] = np.hypot(1.0, _END_S / max(times[-1] - times[0], 1e-3))
    inflated[:, 6:8] /= velocity_gain(recording, rows, parameters)
    inflated = inflated.ravel()
    change = (projection @ difference(calibrated, parameters).ravel()).reshape(n, -1)
    inflated_scores = inflated[:, None] * scores * inflated
    told = information(basis, normal - prior.curvature, inflated_scores, prior.pull(change.ravel()), change.ravel())
    return JointEstimate(
        recording.names,
        parameters,
        change,
        covariance * inflated * inflated[:, None],
        inflated[:, None] * spread,
        *told,
        basis,
        projection,
        rows,
        law,
        float(0.5 * (times[0] + times[-1])),
    )


def _inverse(curvature: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Return the inverse of a curvature that is at least another one, which is positive definite."""
    lower = np.linalg.inv(np.linalg.cholesky(least))
    values, vectors = np.linalg.eigh(lower @ curvature @ lower.T)
    turned = vectors.T @ lower
    return turned.T @ (turned / np.maximum(values, 1.0)[:, None])


def _gauge(rows: Rows, parameters: JointParameters, known: KnownPoses | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions that the data can determine, and the projection onto them along the others.

    The others are the similarities of the world, and a common offset and drift of all clocks. Known poses determine the
    scale.
    """
    n = len(parameters.rotation)
    points = rows.points_m[np.isfinite(rows.points_m).all(axis=-1)]
    origin = np.median(points, axis=0) if len(points) else parameters.center_m.mean(axis=0)
    free = np.zeros((n, parameters.size, _N_SIMILARITY + 2))
    for v in range(n):
        x, y, z = parameters.center_m[v] - origin
        free[v, :3, :3] = -parameters.rotation[v]
        free[v, 3:6, :3] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        free[v, 3:6, 3:6] = np.eye(3)
        free[v, 3:6, 6] = x, y, z
    free[:, 6, 7] = free[:, 7, 8] = 1.0
    if known is not None:
        free = np.delete(free, 6, axis=2)
    distance_m = float(np.median(np.linalg.norm(parameters.center_m - origin, axis=1)))
    weight = np.tile([distance_m**2] * 3 + [1.0] * (parameters.size - 3), n)
    free = free.reshape(n * parameters.size, -1)
    constraint = free * weight[:, None]
    basis = np.linalg.svd(constraint, full_matrices=True)[0][:, free.shape[1] :]
    projection = np.eye(len(free)) - free @ np.linalg.solve(constraint.T @ free, constraint.T)
    return basis, projection
