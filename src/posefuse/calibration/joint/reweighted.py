"""Estimate poses and focal lengths again under a working correlation of the errors over time."""

from dataclasses import replace

import numpy as np

from posefuse.calibration.joint.covariance import design_effect, score_covariance
from posefuse.calibration.joint.equations import linearize, noise_scales, score_responses
from posefuse.calibration.joint.estimate import JointEstimate, with_known_poses
from posefuse.calibration.joint.known_poses import KnownPoses
from posefuse.calibration.joint.noise_law import NoiseLaw
from posefuse.calibration.joint.parameters import difference
from posefuse.calibration.joint.prior import Prior
from posefuse.calibration.joint.recording import JointRecording
from posefuse.calibration.joint.slow_errors import WORKING_LAW, correlated_influences

_STEPS = 6
_CLOCK = (6, 7)


def reweighted(
    joint: JointEstimate,
    recording: JointRecording,
    prior: Prior,
    working: NoiseLaw = WORKING_LAW,
    known: KnownPoses | None = None,
) -> JointEstimate:
    """Return the estimate with the observations weighted by a working correlation.

    Clocks stay as they are, with their covariance: their equations contain velocities, which are measured from
    neighboring frames and share errors with them.

    Args:
        joint: estimate with equal weights.
        recording: its recording.
        prior: its prior.
        working: correlation by which observations are weighted.
        known: what is known of the poses in addition; the prior then keeps its weight.
    """
    rows, parameters = joint.rows, joint.parameters
    n, size = parameters.offset_s.shape[0], parameters.size
    kept = np.flatnonzero(~np.isin(np.arange(n * size) % size, _CLOCK))
    influence = correlated_influences(rows, recording.runs[rows.frames], working)
    rays = np.ascontiguousarray(influence[..., kept])
    curvature = rays.reshape(-1, len(kept)).T @ score_responses(rows).reshape(-1, n * size)[:, kept]
    basis, values, _ = np.linalg.svd(joint.basis[kept], full_matrices=False)
    basis = basis[:, values > 0.5]
    curvature = 0.5 * (curvature + curvature.T)
    prior = with_known_poses(prior, known).part(kept)
    if known is None:
        alike = design_effect(basis, curvature, score_covariance(rays, rows, joint.law))
        prior = prior.weighted(np.full(len(kept), alike))
    spread = basis @ np.linalg.inv(basis.T @ (curvature + prior.curvature) @ basis) @ basis.T
    calibrated = replace(
        parameters,
        rotation=recording.rotation,
        center_m=recording.center_m,
        log_focal=None if parameters.log_focal is None else np.zeros(n),
        radial=None if parameters.radial is None else np.zeros(n),
    )
    delta = np.zeros(n * size)
    for _ in range(_STEPS):
        score = np.einsum("nvk,nvkp->p", rows.scores, rays)
        delta[kept] = spread @ (score - prior.pull(difference(calibrated, parameters).ravel()[kept]))
        parameters = parameters.changed(delta.reshape(n, size))
        rows = linearize(recording, rows.frames, parameters, noise_scales(rows), rows.support_m)
    covariance = joint.covariance.copy()
    clocks = np.setdiff1d(np.arange(n * size), kept)
    covariance[np.ix_(kept, clocks)], covariance[np.ix_(clocks, kept)] = 0.0, 0.0
    covariance[np.ix_(kept, kept)] = spread @ (score_covariance(rays, rows, joint.law) + prior.spread) @ spread
    change = joint.change.ravel().copy()
    change[kept] = (joint.projection @ difference(calibrated, parameters).ravel())[kept]
    return replace(joint, parameters=parameters, change=change.reshape(n, size), covariance=covariance, rows=rows)
