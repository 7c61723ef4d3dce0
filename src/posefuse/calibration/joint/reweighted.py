"""Estimate poses and focal lengths again under a working correlation of the errors over time.

The equations take errors for less similar than they are. A prior therefore counts as many times more: by the same
factor in all directions, or, with known poses, in each direction by as much as the equations overstate the
observations there. The latter is the minimum-variance combination of both (generalized least squares).
"""

from dataclasses import replace

import numpy as np

from posefuse.calibration.joint.covariance import design_effect, score_covariance
from posefuse.calibration.joint.equations import influences, linearize, noise_scales, score_responses
from posefuse.calibration.joint.estimate import JointEstimate, with_known_poses
from posefuse.calibration.joint.known_poses import KnownPoses
from posefuse.calibration.joint.noise_law import NoiseLaw
from posefuse.calibration.joint.parameters import difference
from posefuse.calibration.joint.prior import Prior
from posefuse.calibration.joint.recording import JointRecording
from posefuse.calibration.joint.slow_errors import correlated_influences, working_law

_STEPS = 6
_CLOCK = (6, 7)


def reweighted(
    joint: JointEstimate,
    recording: JointRecording,
    prior: Prior,
    working: NoiseLaw | None = None,
    known: KnownPoses | None = None,
) -> JointEstimate:
    """Return the estimate with the observations weighted by a working correlation.

    Clocks stay as they are, with their covariance: their equations contain velocities, which are measured from
    neighboring frames and share errors with them. The covariance of the poses contains the errors of the clocks, which
    the poses follow.

    Args:
        joint: estimate with equal weights.
        recording: its recording.
        prior: its prior.
        working: correlation by which observations are weighted; by default, it follows from that of the residuals.
        known: what is known of the poses in addition.
    """
    rows, parameters = joint.rows, joint.parameters
    n, size = parameters.offset_s.shape[0], parameters.size
    is_clock = np.isin(np.arange(n * size) % size, _CLOCK)
    kept, clocks = np.flatnonzero(~is_clock), np.flatnonzero(is_clock)
    working = working_law(joint.law) if working is None else working
    influence = correlated_influences(rows, recording.runs[rows.frames], working)
    rays = np.ascontiguousarray(influence[..., kept])
    responses = rays.reshape(-1, len(kept)).T @ score_responses(rows).reshape(-1, n * size)
    curvature = responses[:, kept]
    basis, values, _ = np.linalg.svd(joint.basis[kept], full_matrices=False)
    basis = basis[:, values > 0.5]
    prior = with_known_poses(prior, known).part(kept)
    by_clocks = influences(rows) @ joint.response[clocks].T
    scores = score_covariance(np.concatenate([rays, by_clocks], axis=-1), rows, joint.law)
    shared, scores = scores[: len(kept), len(kept) :], scores[: len(kept), : len(kept)]
    curvature, scores, precision = (
        basis.T @ matrix @ basis for matrix in (0.5 * (curvature + curvature.T), scores, prior.precision)
    )
    if known is None:
        weight = design_effect(np.eye(len(scores)), curvature, scores) * np.eye(len(scores))
    else:
        curvature, weight = overstated(curvature, scores, precision)
    spread = np.linalg.inv(curvature + weight @ precision)
    calibrated = replace(
        parameters,
        rotation=recording.rotation,
        center_m=recording.center_m,
        log_focal=None if parameters.log_focal is None else np.zeros(n),
        radial=None if parameters.radial is None else np.zeros(n),
        principal=None if parameters.principal is None else np.zeros((n, 2)),
    )
    delta = np.zeros(n * size)
    for _ in range(_STEPS):
        score = np.einsum("nvk,nvkp->p", rows.scores, rays)
        away = difference(calibrated, parameters).ravel()[kept] - prior.mean
        delta[kept] = basis @ (spread @ (basis.T @ score - weight @ (basis.T @ (prior.precision @ away))))
        parameters = parameters.changed(delta.reshape(n, size))
        rows = linearize(recording, rows.frames, parameters, noise_scales(rows), rows.support_m)
    inner = basis @ spread @ (scores + weight @ precision @ weight.T) @ spread.T @ basis.T
    response = basis @ spread @ basis.T
    covariance = with_clocks(joint.covariance, clocks, inner, response @ shared, -response @ responses[:, clocks])
    change = joint.change.ravel().copy()
    change[kept] = (joint.projection @ difference(calibrated, parameters).ravel())[kept]
    return replace(joint, parameters=parameters, change=change.reshape(n, size), covariance=covariance, rows=rows)


def with_clocks(
    covariance: np.ndarray, clocks: np.ndarray, fixed: np.ndarray, shared: np.ndarray, follow: np.ndarray
) -> np.ndarray:
    """Return the covariance of clocks and of other parameters that follow them.

    Args:
        covariance: shape (parameter, parameter): holds that of the clocks.
        clocks: shape (clock,), int: their indices.
        fixed: shape (other, other): covariance of the other parameters at exact clocks.
        shared: shape (other, clock): covariance of these with the errors of the clocks, which have the same causes.
        follow: shape (other, clock): derivatives of the other parameters by the clocks.
    """
    out, others = covariance.copy(), np.setdiff1d(np.arange(len(covariance)), clocks)
    both = shared + follow @ covariance[np.ix_(clocks, clocks)]
    out[np.ix_(others, clocks)], out[np.ix_(clocks, others)] = both, both.T
    out[np.ix_(others, others)] = fixed + shared @ follow.T + follow @ both.T
    return out


def overstated(curvature: np.ndarray, scores: np.ndarray, precision: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the curvature without negative values, and by how much it overstates the observations.

    Directions in which the prior is far more certain than the observations keep its weight.

    Args:
        curvature: shape (free, free).
        scores: shape (free, free): covariance of the score.
        precision: shape (free, free): that of the prior.
    """
    root = np.linalg.cholesky(precision)
    lower = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(lower @ curvature @ lower.T)
    values = np.maximum(values, 0.0)
    inner = lower @ scores @ lower.T + np.eye(len(root))
    weight = root @ inner @ (vectors / (1.0 + values)) @ vectors.T @ lower
    half = root @ vectors
    return (half * values) @ half.T, weight
