"""Unknown focal lengths: different, or nearly the same because the cameras are of one kind.

Which of both holds is a matter of probability. Without enough observations to tell, the result is the mean of both
estimates, and its covariance contains their difference.
"""

from dataclasses import replace

import numpy as np

from posefuse.calibration.joint.equations import linearize
from posefuse.calibration.joint.estimate import JointEstimate
from posefuse.calibration.joint.parameters import difference
from posefuse.calibration.joint.prior import Prior
from posefuse.calibration.joint.recording import JointRecording
from posefuse.kernels.calibration.joint import FOCAL

DIFFERENT_SD, SAME_SD = 0.15, 0.015
"""Standard deviations of the focal lengths relative to their mean, of different cameras and of cameras of one kind."""
COMMON_SD = 0.35
"""Standard deviation of the mean focal length relative to the approximate one."""
_USUALLY_SAME = 0.5
"""Probability that cameras of unknown focal length are of one kind."""
NEGLIGIBLE = 0.02
"""Probability below which cameras count as different."""


def focal_prior(prior: Prior, log_focal: np.ndarray, sd: float) -> Prior:
    """Return a prior under which unknown focal lengths are similar.

    Args:
        prior: prior of all views, with their lenses.
        log_focal: shape (view,): logarithm of the focal length of the recording's coordinates relative to the image
            size; NaN where it is known.
        sd: standard deviation of the focal lengths relative to their mean.
    """
    unknown = np.flatnonzero(np.isfinite(log_focal))
    if len(unknown) == 0:
        return prior
    columns = unknown * (len(prior.mean) // len(log_focal)) + FOCAL
    covariance = COMMON_SD**2 + sd**2 * np.eye(len(unknown))
    return prior.coupled(columns, covariance, np.median(log_focal[unknown]) - log_focal[unknown])


def probability_of_one_kind(joint: JointEstimate, log_focal: np.ndarray) -> float:
    """Return the probability that unknown focal lengths have the standard deviation of cameras of one kind.

    Args:
        joint: estimate under the prior of different cameras.
        log_focal: shape (view,): as for :func:`focal_prior`.
    """
    parameters = joint.parameters
    unknown = np.flatnonzero(np.isfinite(log_focal))
    if parameters.log_focal is None or len(unknown) < 2:
        return 0.0
    n = len(unknown) - 1
    # Differences in an orthonormal basis of all changes that keep the mean.
    contrast = np.linalg.svd(np.eye(n + 1) - 1.0 / (n + 1))[0][:, :n].T
    differences = contrast @ (log_focal + parameters.log_focal)[unknown]
    columns = unknown * parameters.size + FOCAL
    posterior = contrast @ joint.covariance[np.ix_(columns, columns)] @ contrast.T
    # The density of the posterior at equal focal lengths relative to that of the prior (Dickey 1971).
    spread = posterior + SAME_SD**2 * np.eye(n)
    squared = float(differences @ np.linalg.solve(spread, differences))
    before = n * np.log(DIFFERENT_SD**2 + SAME_SD**2)
    log_odds = 0.5 * (before - np.linalg.slogdet(spread)[1] - squared) + np.log(_USUALLY_SAME / (1.0 - _USUALLY_SAME))
    return float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -50.0, 50.0))))


def mixed(
    different: JointEstimate, same: JointEstimate, probability: float, recording: JointRecording
) -> JointEstimate:
    """Return the mean of two estimates, with the covariance of their mixture.

    Args:
        different: first estimate.
        same: second estimate.
        probability: that of the second one.
        recording: the recording of both.
    """
    apart = difference(different.parameters, same.parameters)
    spread = (1.0 - probability) * different.covariance + probability * same.covariance
    # Both have the same world: that of the calibration.
    moved = different.projection @ apart.ravel()
    parameters = different.parameters.changed(probability * apart)
    return replace(
        different,
        parameters=parameters,
        change=different.change + probability * moved.reshape(apart.shape),
        covariance=spread + probability * (1.0 - probability) * np.outer(moved, moved),
        rows=linearize(recording, different.rows.frames, parameters, different.rows.scale, different.rows.support_m),
    )
