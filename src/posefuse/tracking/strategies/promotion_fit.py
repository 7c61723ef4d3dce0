"""First body of a confirmed track: bone lengths by weighted medians over the buffer, and a pose of the core keypoints.

Source: the specification of the articulated tracker, see docs/methods/specification.md.
"""

import numpy as np

from posefuse.kernels.tracking.pose_fit import fit_pose
from posefuse.kernels.tracking.records import Pose, State
from posefuse.kinematics.initial_pose import initial_covariance, initial_state
from posefuse.skeleton.limbs import Limbs, core_limbs
from posefuse.tracking.body_states import select_states
from posefuse.tracking.records import Observation, PastState
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategies.tentative_state import tentative_state
from posefuse.tracking.track_initiation import reprojection_error_sigma

_ITERATIONS = 30
"""Limit of the Gauss-Newton steps of a pose."""


def fit_first_body(
    observations: list[Observation], settings: TrackerSettings
) -> tuple[State, list[PastState], float]:  # fmt: skip
    """Fit a body to the buffer of a tentative track.

    Args:
        observations: Buffer of the track, oldest first.
        settings: Settings of the tracker.

    Returns:
        State of one body in the last frame; states in the frames before it; and the median reprojection error in the
        last frame, in standard deviations.
    """
    shape_m, shape_covariance = fit_shape(observations, settings)
    past = [
        PastState(
            each.number,
            each.time_s,
            fit_core_pose(each.points_m, shape_m, settings),
            each.rows,
            each.keypoints_px,
            each.confidence,
        )
        for each in observations[:-1]
    ]
    last = observations[-1]
    tentative = tentative_state(observations, last.time_s, settings)
    points = last.points_m.copy()
    points[settings.core] = tentative.poses.root_m + tentative.poses.core_m
    state = fit_core_pose(points, shape_m, settings)
    state.velocity[0, :3] = tentative.root_velocity_m_s
    state.covariance[0] = initial_covariance(settings.tree, shape_covariance, settings.options.motion)
    return state, past, reprojection_error_sigma(state, last, settings)


def measured_limbs(observations: list[Observation], limbs: Limbs) -> tuple[np.ndarray, np.ndarray]:
    """Return the weighted medians of limb lengths, and the mean variances of a measurement, shape (limb,) each.

    The weight of a frame is the inverse variance of its length. Limbs that no frame shows have NaN.

    Args:
        observations: Buffer of a tentative track.
        limbs: Limbs to measure.
    """
    points = np.stack([each.points_m for each in observations])
    variance = np.stack([each.covariance_m2[:, (0, 3, 5)].mean(axis=1) for each in observations])
    lengths = np.linalg.norm(points[:, limbs.keypoints[:, 1]] - points[:, limbs.keypoints[:, 0]], axis=-1)
    spread = variance[:, limbs.keypoints].sum(axis=-1)
    medians, means = np.full(len(limbs), np.nan), np.full(len(limbs), np.nan)
    for b in range(len(limbs)):
        known = np.isfinite(lengths[:, b]) & (spread[:, b] > 0.0)
        if known.any():
            weights = 1.0 / spread[known, b]
            medians[b] = weighted_median(lengths[known, b], weights)
            means[b] = len(weights) / weights.sum()
    return medians, means


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    """Return the smallest value up to which the weights sum to at least half of their total."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def fit_shape(observations: list[Observation], settings: TrackerSettings) -> tuple[np.ndarray, np.ndarray]:
    """Return the bone lengths of a buffer and their covariance: medians of limbs with the prior of all people.

    They minimize the sum of omega_b (l_b(beta) - l_b)^2 and lambda_beta |beta - beta_0|^2 in units of the tree's
    covariance; 1 / omega_b is the mean variance of a measured length plus that of the systematic offsets of its ends.

    Args:
        observations: Buffer of a tentative track.
        settings: Settings of the tracker.
    """
    from scipy.optimize import least_squares  # Takes 0.2 s to load, and only one strategy needs it.

    tree, options = settings.tree, settings.options
    limbs = core_limbs(settings.skeleton, tree)
    medians, variance = measured_limbs(observations, limbs)
    shown = np.isfinite(medians)
    sigma = np.sqrt(variance[shown] + 2.0 * options.model_floor_m**2)
    information = options.specification.shape_weight * np.linalg.inv(tree.shape_covariance)
    whiten = np.linalg.cholesky(0.5 * (information + information.T)).T

    def residuals(shape_m: np.ndarray) -> np.ndarray:
        measured = (limbs.lengths_m(tree, shape_m)[shown] - medians[shown]) / sigma
        return np.concatenate([measured, whiten @ (shape_m - tree.shape_m)])

    solved = least_squares(residuals, tree.shape_m, method="lm", x_scale=np.sqrt(np.diag(tree.shape_covariance)))
    covariance = np.linalg.inv(solved.jac.T @ solved.jac)
    return solved.x, 0.5 * (covariance + covariance.T)


def fit_core_pose(points_m: np.ndarray, shape_m: np.ndarray, settings: TrackerSettings) -> State:
    """Return the state of one body at rest whose core keypoints are closest to points, within its joint limits.

    The steps start at the pose that all points show; keypoints outside the core only determine this start.

    Args:
        points_m: shape (keypoint, 3), NaN where missing.
        shape_m: shape (shape,): bone lengths.
        settings: Settings of the tracker.
    """
    tree, options = settings.tree, settings.options
    state = initial_state(tree, points_m, shape_m, tree.shape_covariance, options.motion)
    targets = np.full_like(points_m, np.nan)
    targets[settings.core] = points_m[settings.core]
    pose = Pose(state.root[0], state.turns[0], state.bones[0], state.shape[0])
    weight, stiffness = options.specification.core_fit_sd_m**-2, options.limit_sigma**-2
    fit_pose(settings.body, pose, targets, weight, stiffness, _ITERATIONS)
    return select_states(state, [0])
