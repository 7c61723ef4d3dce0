"""How probable bodies are under approximate cameras, and whether one explanation is significantly better than another.

The test is that of Q. H. Vuong, "Likelihood ratio tests for model selection and non-nested hypotheses", Econometrica
57, 1989. Errors of detectors persist over time and differ between keypoints; differences of costs are therefore summed
over seconds and over keypoints, and the sums that scatter more give the standard deviation.
"""

from dataclasses import replace

import numpy as np

from posefuse.calibration.people.bodies import BodySamples, Bones
from posefuse.calibration.people.body_bundle import (
    BodyState,
    bounded_scale,
    median_scale,
    points_information,
    pooled_scale,
    residual_share,
    residuals_of,
)
from posefuse.kernels.calibration.body_bundle import STUDENT_T_DOF

SIGNIFICANT = 2.0
"""Standard deviations from which one explanation is significantly better than another."""
_BLOCK_S = 2.0
_MIN_BLOCKS = 5
_FAR = 100.0
"""Distance of points, relative to the length of bones, that is improbable."""
_OUTLIER = 100.0
"""Cost of a point behind a camera, as an error in standard deviations."""


def body_costs(samples: BodySamples, bones: Bones, state: BodyState) -> np.ndarray:
    """Return the negative logarithm of the probability of observations and bones, shape (sample, keypoint).

    All views have the same noise relative to the nominal one: points that follow one view alone would otherwise make
    its errors arbitrarily small. The cost of a bone is that of its ends, in halves.

    Args:
        samples: observations.
        bones: bones of the skeleton.
        state: cameras and bodies.
    """
    residuals = residuals_of(samples, state)
    costs = observation_costs(residuals, pooled_scale(residuals)).sum(axis=1)
    return costs + _bone_costs(bones, samples, state)


def camera_costs(samples: BodySamples, bones: Bones, state: BodyState) -> np.ndarray:
    """Return the negative logarithm of the probability of observations by cameras, shape (sample, keypoint).

    The likelihood of cameras is an integral over all points (Laplace 1774). A maximum alone prefers cameras that let
    points and bones follow their observations (J. Neyman and E. L. Scott, Econometrica 16, 1948). Arguments as of
    :func:`body_costs`.
    """
    residuals = residuals_of(samples, state)
    scale = bounded_scale(median_scale(residuals) / np.sqrt(residual_share(samples, bones, state)))
    costs = observation_costs(residuals, scale).sum(axis=1)
    return costs + _bone_costs(bones, samples, state) + _volumes(samples, bones, state, scale)


def _bone_costs(bones: Bones, samples: BodySamples, state: BodyState) -> np.ndarray:
    """Return the costs of bones by the keypoints at their ends, shape (sample, keypoint)."""
    costs = np.zeros(state.points.shape[:2])
    first, second = bones.ends.T
    with np.errstate(divide="ignore"):
        log_length = np.log(np.linalg.norm(state.points[:, first] - state.points[:, second], axis=-1))
    change = (log_length - state.log_lengths[samples.person][:, bones.length]) / bones.sd
    known = np.isfinite(change)
    of_bones = 0.5 * (STUDENT_T_DOF + 1.0) * np.log1p(np.where(known, change, 0.0) ** 2 / STUDENT_T_DOF)
    for bone, (a, b) in enumerate(bones.ends):
        costs[:, a] += 0.5 * of_bones[:, bone]
        costs[:, b] += 0.5 * of_bones[:, bone]
    return costs


def _volumes(samples: BodySamples, bones: Bones, state: BodyState, scale: float) -> np.ndarray:
    """Return the logarithms of the inverse volumes in which points explain their observations, (sample, keypoint)."""
    pooled = replace(state, scale=np.full_like(state.scale, scale))
    information = points_information(samples, bones, pooled)
    # Relative to the size of bodies, so that the costs do not depend on the unit of length.
    information = information * np.square(_body_sizes(samples, state))[:, None, None]
    n, size = information.shape[0], information.shape[1] // 3
    seen = np.einsum("sii->si", information)[:, ::3] > 0.0
    matrices = information + _FAR**-2.0 * np.eye(3 * size)
    total = np.where(np.repeat(seen, 3, axis=1), np.log(np.einsum("sii->si", np.linalg.cholesky(matrices))), 0.0)
    own = np.stack([matrices[:, 3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(size)], axis=1)
    alone = np.where(seen, 0.5 * np.linalg.slogdet(own)[1], 0.0)
    # Bones relate keypoints; what they add belongs to all of a body.
    shared = (total.sum(axis=1) - alone.sum(axis=1)) / np.maximum(seen.sum(axis=1), 1)
    return np.where(seen, alone + shared[:, None], 0.0).reshape(n, size)


def _body_sizes(samples: BodySamples, state: BodyState) -> np.ndarray:
    """Return the size of the body of each sample: of its bones, or without any, of its points."""
    if state.log_lengths.shape[1]:
        return np.exp(state.log_lengths.mean(axis=1))[samples.person]
    spread = np.linalg.norm(state.points - np.nanmean(state.points, axis=(0, 1)), axis=-1)
    return np.full(len(state.points), np.nanmedian(spread))


def observation_costs(residuals: np.ndarray, scale: float) -> np.ndarray:
    """Return the negative logarithm of the probability of observations, 0 where missing.

    Args:
        residuals: lengths in units of the nominal noise, NaN where missing, infinite behind the camera.
        scale: noise relative to the nominal one.
    """
    seen = ~np.isnan(residuals)
    relative = np.minimum(np.where(seen, residuals, 0.0) / scale, _OUTLIER)
    costs = 0.5 * (STUDENT_T_DOF + 2.0) * np.log1p(relative**2 / STUDENT_T_DOF) + 2.0 * np.log(scale)
    return np.where(seen, costs, 0.0)


def advantage(costs: np.ndarray, other: np.ndarray, time_s: np.ndarray | None) -> float:
    """Return by how many standard deviations costs are lower than others; 0 without a difference.

    Args:
        costs: shape (sample, keypoint).
        other: shape (sample, keypoint): of the same or of corresponding samples.
        time_s: shape (sample,); None if one moment may decide, so that only sums over keypoints are compared.
    """
    gain = other - costs
    total = float(gain.sum())
    variance = max(_scatter(gain.sum(axis=0)), 0.0 if time_s is None else _scatter(_sums_over_time(gain, time_s)))
    return total / np.sqrt(variance) if variance > 0.0 else float(np.copysign(np.inf, total)) if total else 0.0


def _sums_over_time(gain: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return the sums of blocks of time, shape (block,)."""
    span_s = float(np.ptp(time_s))
    length_s = max(min(_BLOCK_S, span_s / _MIN_BLOCKS), 1e-9)
    block = np.minimum((time_s - time_s.min()) / length_s, max(round(span_s / length_s), 1) - 0.5).astype(np.int64)
    return np.array([gain[block == k].sum() for k in np.unique(block)])


def _scatter(sums: np.ndarray) -> float:
    """Return the variance of a total of independent sums."""
    n = len(sums)
    return float(np.square(sums - sums.mean()).sum()) * n / (n - 1) if n > 1 else 0.0
