"""Cameras of one kind have nearly the same focal length: use it if the recording does not contradict it."""

from dataclasses import replace

import numpy as np

from posefuse.calibration.joint.estimate import JointEstimate, estimate
from posefuse.calibration.joint.recording import JointRecording
from posefuse.calibration.joint.reweighted import reweighted
from posefuse.kernels.calibration.joint import FOCAL

SHARED_SD = 0.015
"""Standard deviation of the focal lengths of cameras of one kind, relative to their mean."""
_MIN_VIEWS = 2
_CAUTION = 2.0
"""Factor of the variances: errors of detectors that depend on the direction of view are larger than stated."""


def with_shared_focal(
    joint: JointEstimate, recording: JointRecording, prior_sd: np.ndarray, log_focal: np.ndarray
) -> JointEstimate:
    """Return the estimate given that unknown focal lengths are similar, or the same if they differ significantly.

    Args:
        joint: estimate with independent focal lengths.
        recording: its recording.
        prior_sd: shape (view, parameter): its prior.
        log_focal: shape (view,): logarithm of the focal length of the recording's coordinates relative to the image
            size; NaN where it is known.
    """
    parameters = joint.parameters
    unknown = np.flatnonzero(np.isfinite(log_focal))
    if parameters.log_focal is None or len(unknown) < _MIN_VIEWS:
        return joint
    each = parameters.size
    center = np.eye(len(unknown)) - 1.0 / len(unknown)
    # Differences in an orthonormal basis of all changes that keep the mean.
    contrast = np.linalg.svd(center)[0][:, : len(unknown) - 1].T
    differences = contrast @ (log_focal + parameters.log_focal)[unknown]
    columns = unknown * each + FOCAL
    shared = joint.covariance[:, columns] @ contrast.T
    spread = contrast @ shared[columns] + SHARED_SD**2 * np.eye(len(differences))
    squared = float(differences @ np.linalg.solve(spread, differences))
    if squared > _CAUTION * (len(differences) + 2.0 * np.sqrt(2.0 * len(differences))):
        return joint
    gain = np.linalg.solve(spread, shared.T).T
    covariance = joint.covariance - gain @ shared.T
    change = np.zeros((len(log_focal), each))
    change[:, FOCAL:] = -(gain @ differences).reshape(-1, each)[:, FOCAL:]
    lenses = parameters.changed(change)
    xy, sigma = lenses.without_lens(np.moveaxis(recording.xy, 1, 2).copy(), np.moveaxis(recording.sigma, 1, 2).copy())
    fixed = replace(recording, xy=np.moveaxis(xy, 2, 1), sigma=np.moveaxis(sigma, 2, 1))
    start = replace(parameters, log_focal=None, radial=None)
    again = estimate(fixed, start, prior_sd=prior_sd[:, :FOCAL], frames=joint.rows.frames)
    if again is None:
        return joint
    again = reweighted(again, fixed, prior_sd[:, :FOCAL])
    poses = replace(again.parameters, log_focal=lenses.log_focal, radial=lenses.radial)
    return replace(joint, parameters=poses, covariance=0.5 * (covariance + covariance.T), rows=again.rows)
