"""Unknown lenses: focal lengths of cameras of one kind, or more or less different, and similar distortions.

By how much they differ is a matter of probability. Without enough observations to tell, the result is the mean of the
estimates under several priors, and its covariance holds also for the most different cameras among these.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posefuse.calibration.joint.equations import linearize
from posefuse.calibration.joint.estimate import JointEstimate
from posefuse.calibration.joint.parameters import difference
from posefuse.calibration.joint.prior import Prior
from posefuse.calibration.joint.recording import JointRecording
from posefuse.kernels.calibration.joint import FOCAL, RADIAL

SPREADS = (0.15, 0.05, 0.015)
"""Standard deviations of the focal lengths relative to their mean: of different cameras, similar ones, and one kind.

With the extremes alone, many cameras that differ by a few percent each would count as equal: they are even less
probable among cameras that differ by 15 %. Before the recording, all three are equally probable.
"""
_COMMON_SD = 0.35
"""Standard deviation of the mean focal length relative to the approximate one."""
_COMMON_RADIAL_SD, _OWN_RADIAL_SD = 0.22, 0.1
"""Standard deviations of the first coefficient of radial distortion: of its mean over the cameras, and around it."""
_NEGLIGIBLE = 0.02
"""Probability below which a spread is left out."""
_LEAST_INFORMATION = 1e-6


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
    covariance = _COMMON_SD**2 + sd**2 * np.eye(len(unknown))
    return prior.coupled(columns, covariance, np.median(log_focal[unknown]) - log_focal[unknown])


def distortion_prior(prior: Prior, unknown: np.ndarray) -> Prior:
    """Return a prior under which unknown distortions are similar.

    Cameras of one recording are mostly of one kind. If their coefficients were independent, a common distortion of all
    would be a coincidence, and the prior would reject it.

    Args:
        prior: prior of all views, with their lenses.
        unknown: shape (view,), bool: whether the distortion is unknown.
    """
    columns = np.flatnonzero(unknown) * (len(prior.mean) // len(unknown)) + RADIAL
    if len(columns) == 0:
        return prior
    covariance = _COMMON_RADIAL_SD**2 + _OWN_RADIAL_SD**2 * np.eye(len(columns))
    return prior.coupled(columns, covariance, np.zeros(len(columns)))


def spread_probabilities(joint: JointEstimate, log_focal: np.ndarray) -> np.ndarray:
    """Return the probability of each of :data:`SPREADS`, negligible ones 0.

    Args:
        joint: estimate under the prior of different cameras, the first of :data:`SPREADS`.
        log_focal: shape (view,): as for :func:`focal_prior`.
    """
    parameters = joint.parameters
    unknown = np.flatnonzero(np.isfinite(log_focal))
    if parameters.log_focal is None or len(unknown) < 2:
        return np.array([1.0] + [0.0] * (len(SPREADS) - 1))
    n = len(unknown) - 1
    # Differences in an orthonormal basis of all changes that keep the mean.
    contrast = np.linalg.svd(np.eye(n + 1) - 1.0 / (n + 1))[0][:, :n].T
    differences = contrast @ (log_focal + parameters.log_focal)[unknown]
    columns = unknown * parameters.size + FOCAL
    posterior = contrast @ joint.covariance[np.ix_(columns, columns)] @ contrast.T
    # What the recording tells is the posterior without its prior.
    values, vectors = np.linalg.eigh(posterior)
    told = np.maximum(1.0 / values - SPREADS[0] ** -2.0, _LEAST_INFORMATION)
    pull = (vectors.T @ differences) / values
    log_evidence = [0.5 * float((pull**2 / (told + sd**-2.0)).sum() - np.log1p(sd**2 * told).sum()) for sd in SPREADS]
    odds = np.exp(np.array(log_evidence) - max(log_evidence))
    probability = odds / odds.sum()
    probability[probability < _NEGLIGIBLE] = 0.0
    return probability / probability.sum()


def mixed(estimates: Sequence[JointEstimate], probability: np.ndarray, recording: JointRecording) -> JointEstimate:
    """Return the mean of estimates, with the covariance that the one under the widest spread gives it.

    Cameras that differ would be less certain than the covariance of the mixture states: where the recording hardly
    tells, half of it assumes cameras of one kind. The covariance is therefore that of the widest spread that is not
    negligible, and contains the distance of that estimate from the mean.

    Args:
        estimates: in the same world, that of the calibration, from the widest spread to the narrowest.
        probability: shape (estimate,): their probabilities, negligible ones 0.
        recording: the recording of all.
    """
    first = estimates[0]
    apart = [difference(first.parameters, each.parameters) for each in estimates]
    mean = sum((p * a for p, a in zip(probability, apart, strict=True)), np.zeros_like(apart[0]))
    widest = int(np.flatnonzero(probability)[0])
    moved = first.projection @ (apart[widest] - mean).ravel()
    parameters = first.parameters.changed(mean)
    return replace(
        first,
        parameters=parameters,
        change=first.change + (first.projection @ mean.ravel()).reshape(mean.shape),
        covariance=estimates[widest].covariance + np.outer(moved, moved),
        rows=linearize(recording, first.rows.frames, parameters, first.rows.scale, first.rows.support_m),
    )
