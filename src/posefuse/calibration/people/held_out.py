"""Reprojection errors of held-out views in held-out frames: a check that needs no assumption about the noise."""

import numpy as np

from posefuse.calibration.joint.estimate import JointEstimate, estimate
from posefuse.calibration.joint.known_poses import KnownPoses
from posefuse.calibration.joint.noise_law import STUDENT_T_DOF
from posefuse.calibration.joint.parameters import JointParameters
from posefuse.calibration.joint.prior import Prior
from posefuse.calibration.joint.recording import JointRecording
from posefuse.kernels.calibration.joint import linear_points, refine_points

_MAX_FRAMES, _MIN_FRAMES = 80, 10
_POINT_STEPS = 5


def held_out_errors(
    recording: JointRecording, joint: JointEstimate, prior: Prior, known: KnownPoses | None = None
) -> np.ndarray:
    """Return the median reprojection error of each view in the normalized image plane, shape (view,).

    The cameras are estimated from one half of the recording, and points of the other half from all views but one.

    Args:
        recording: the keypoints.
        joint: estimate from the whole recording.
        prior: its prior.
        known: what is known of the poses in addition.
    """
    frames = joint.rows.frames
    frames = frames[:: max(1, -(-len(frames) // (2 * _MAX_FRAMES)))]
    halves = np.array_split(frames, 2)
    errors: list[list[np.ndarray]] = [[] for _ in joint.names]
    for k, half in enumerate(halves):
        other = halves[1 - k]
        # Too few frames determine no cameras: those of the whole recording then serve.
        found = (
            estimate(recording, joint.parameters, prior=prior, frames=other, known=known)
            if len(other) >= _MIN_FRAMES
            else None
        )
        for v, distances in enumerate(_errors(recording, half, (found or joint).parameters)):
            errors[v].append(distances)
    joined = [np.concatenate(each) for each in errors]
    return np.array([float(np.median(each)) if len(each) else np.nan for each in joined])


def _errors(recording: JointRecording, frames: np.ndarray, parameters: JointParameters) -> list[np.ndarray]:
    """Return the distances between each view's observations and the points of the other views."""
    times = recording.moments_s[frames]
    since = times - 0.5 * (times[0] + times[-1])
    xy, sigma = recording.at(frames, parameters.offset_s + since[:, None] * parameters.drift)
    n_views = recording.n_views
    xy, sigma = parameters.without_lens(xy, sigma)
    xy, sigma = xy.reshape(-1, n_views, 2), sigma.reshape(-1, n_views)
    rotation, center = np.ascontiguousarray(parameters.rotation), np.ascontiguousarray(parameters.center_m)
    out = []
    for v in range(n_views):
        others, points = xy.copy(), np.full((len(xy), 3), np.nan)
        others[:, v] = np.nan
        linear_points(others, rotation, center, points)
        refine_points(others, np.nan_to_num(sigma), rotation, center, STUDENT_T_DOF, _POINT_STEPS, points)
        seen = (points - center[v]) @ rotation[v].T
        with np.errstate(invalid="ignore", divide="ignore"):
            distance = np.linalg.norm(xy[:, v] - seen[:, :2] / seen[:, 2:], axis=-1)
        out.append(distance[np.isfinite(distance)])
    return out
