"""How probable bodies are under approximate cameras, and whether one explanation is significantly better than another.

The test is that of Q. H. Vuong, "Likelihood ratio tests for model selection and non-nested hypotheses", Econometrica
57, 1989. Errors of detectors persist over time and differ between keypoints; differences of costs are therefore summed
over seconds and over keypoints, and the sums that scatter more give the standard deviation.
"""

import numpy as np

from posefuse.calibration.people.bodies import BodySamples, Bones
from posefuse.calibration.people.body_bundle import BodyState, pooled_scale, residuals_of
from posefuse.kernels.calibration.body_bundle import STUDENT_T_DOF

SIGNIFICANT = 2.0
"""Standard deviations from which one explanation is significantly better than another."""
_BLOCK_S = 2.0
_MIN_BLOCKS = 5
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


def advantage(costs: np.ndarray, other: np.ndarray, time_s: np.ndarray) -> float:
    """Return by how many standard deviations costs are lower than others; 0 without a difference.

    Args:
        costs: shape (sample, keypoint).
        other: shape (sample, keypoint): of the same or of corresponding samples.
        time_s: shape (sample,).
    """
    gain = other - costs
    total = float(gain.sum())
    span_s = float(np.ptp(time_s))
    length_s = max(min(_BLOCK_S, span_s / _MIN_BLOCKS), 1e-9)
    block = np.minimum((time_s - time_s.min()) / length_s, max(round(span_s / length_s), 1) - 0.5).astype(np.int64)
    used = np.unique(block)
    by_time = np.array([gain[block == k].sum() for k in used])
    sd = np.sqrt(max(_scatter(by_time), _scatter(gain.sum(axis=0))))
    return total / sd if sd > 0.0 else float(np.copysign(np.inf, total)) if total else 0.0


def _scatter(sums: np.ndarray) -> float:
    """Return the variance of a total of independent sums."""
    n = len(sums)
    return float(np.square(sums - sums.mean()).sum()) * n / (n - 1) if n > 1 else 0.0
