"""How well people agree with known poses, as a factor of the variances of what people tell.

Detectors err in the same way for seconds, and a part of that is in no model: errors of calibrations by people may
exceed their standard deviations. Known poses show by how much in this recording (Birge 1932, The Calculation of Errors
by the Method of Least Squares).
"""

from dataclasses import replace

import numpy as np

from posefuse.calibration.joint.estimate import JointEstimate, estimate, with_known_poses
from posefuse.calibration.joint.known_poses import KnownPoses
from posefuse.calibration.joint.prior import Prior
from posefuse.calibration.joint.recording import JointRecording
from posefuse.calibration.joint.reweighted import reweighted

_USUAL = 5.0
"""Degrees of freedom by which the expected factor, 1, counts."""
_CLOCKS = (6, 7)
_RANK_TOLERANCE = 1e-12


def estimate_with_prior(
    recording: JointRecording, start: JointEstimate, prior: Prior, known: KnownPoses
) -> tuple[JointEstimate, KnownPoses]:
    """Return the estimate from a recording and known poses, and the prior by which it weighted these.

    Args:
        recording: the keypoints.
        start: where to start.
        prior: the prior without the known poses.
        known: the known poses.
    """
    joint = estimate(recording, start.parameters, prior=prior, known=known) or start
    factor = variance_factor(joint, with_known_poses(prior, known).precision)
    # The data of variance f S and the prior of variance P have the same solution as S and P / f.
    known = replace(known, precision=factor * known.precision)
    if factor > 1.0:
        joint = estimate(recording, joint.parameters, prior=prior, known=known) or joint
    joint = reweighted(joint, recording, prior, known=known)
    is_clock = np.isin(np.arange(len(joint.covariance)) % joint.parameters.size, _CLOCKS)
    sd = np.where(is_clock, 1.0, np.sqrt(factor))
    return replace(joint, covariance=joint.covariance * sd * sd[:, None]), known


def variance_factor(joint: JointEstimate, prior: np.ndarray) -> float:
    """Return by what factor the difference between people and a prior exceeds its expected square, at least 1.

    Args:
        joint: an estimate with the prior.
        prior: shape (view * parameter,) twice: inverse covariance of the prior.
    """
    values, vectors = np.linalg.eigh(joint.information)
    used = values > _RANK_TOLERANCE * max(float(values[-1]), 1e-300)
    roots, vectors = np.sqrt(values[used]), vectors[:, used]
    # The data is ``measured = root @ change + error`` with errors of unit variance.
    measured, root = (vectors.T @ joint.evidence_score) / roots, roots[:, None] * vectors.T
    spread = np.eye(len(roots)) + root @ np.linalg.solve(joint.basis.T @ prior @ joint.basis, root.T)
    squared = float(measured @ np.linalg.solve(spread, measured))
    expected = float(np.trace(np.linalg.inv(spread)))
    return max(1.0, (squared + _USUAL) / (expected + _USUAL))
