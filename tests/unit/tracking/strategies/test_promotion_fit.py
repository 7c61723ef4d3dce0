"""First body of a track: medians, lengths and poses against direct minimizations of the equations."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.limbs import core_limbs
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import ProjectedBodies, select_states
from posefuse.tracking.records import Observation, TentativeTrack
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategies import specification
from posefuse.tracking.strategies.promotion_fit import (
    fit_core_pose,
    fit_first_body,
    fit_shape,
    measured_limbs,
    weighted_median,
)

SKELETON = shipped_skeleton("body_20")
RIG = build_rig("ring", 4)


def settings_with(**changed: Any) -> TrackerSettings:
    options = TrackerOptions(strategy="specification")
    options = replace(options, specification=replace(options.specification, **changed))
    return TrackerSettings.of(RIG, SKELETON, NoiseModel(np.full(4, 5.0), 1.0), options)


SETTINGS = settings_with()
TREE, CORE = SETTINGS.tree, SETTINGS.core
LIMBS = core_limbs(SKELETON, TREE)


def person(rng: np.random.Generator, scale: float = 1.0, bend: float = 0.3) -> State:
    """Return an upright person with bent limbs whose lengths are all scaled."""
    points = np.full((len(SKELETON), 3), np.nan)
    points[SKELETON.index("mid_hip")] = [0.2, -0.1, 0.95]
    shape = scale * np.asarray(TREE.shape_m)
    state = initial_state(TREE, points, shape, TREE.shape_covariance, SETTINGS.options.motion)
    state.bones[0] = state.bones[0] @ Rotation.from_rotvec(bend * rng.normal(size=(len(TREE.bones), 3))).as_matrix()
    return state


def points_of(state: State) -> np.ndarray:
    return ProjectedBodies.of(state, SETTINGS.cameras[:0], SETTINGS.body).points_m[0]


def observation(time_s: float, points_m: np.ndarray, variance_m2: np.ndarray | float = 1e-4) -> Observation:
    shape = (len(RIG), len(SKELETON))
    covariance = np.zeros((len(SKELETON), 6))
    covariance[:, (0, 3, 5)] = np.broadcast_to(variance_m2, len(SKELETON))[:, None]
    return Observation(
        time_s, 0, RIG.project(points_m[None])[0], np.ones(shape), np.arange(len(RIG)), points_m, covariance,
        points_m[CORE].mean(axis=0), 1.0, 1.0,
    )  # fmt: skip


def buffer(rng: np.random.Generator, state: State, n: int = 7, sd_m: float = 0.01) -> list[Observation]:
    """Return noisy observations of a person who stands still, of different quality."""
    seen = []
    for i in range(n):
        variance = sd_m**2 * rng.uniform(0.5, 4.0, len(SKELETON))
        points = points_of(state) + np.sqrt(variance)[:, None] * rng.normal(size=(len(SKELETON), 3))
        seen.append(observation(0.04 * i, points, variance))
    return seen


@given(st.lists(st.tuples(st.integers(-50, 50), st.integers(1, 5)), min_size=1, max_size=12))
def test_weighted_median_is_the_median_of_repeated_values(pairs: list[tuple[int, int]]) -> None:
    values, counts = (np.array(each) for each in zip(*pairs, strict=True))
    repeated = np.sort(np.repeat(values, counts))
    lower = repeated[(len(repeated) - 1) // 2]
    assert weighted_median(values.astype(float), counts.astype(float)) == lower


def test_limb_lengths_are_weighted_medians(rng: np.random.Generator) -> None:
    seen = buffer(rng, person(rng))
    seen[2].points_m[LIMBS.keypoints[0, 0]] = np.nan
    medians, variances = measured_limbs(seen, LIMBS)
    for b, (i, j) in enumerate(LIMBS.keypoints):
        lengths, weights = [], []
        for each in seen:
            length = np.linalg.norm(each.points_m[j] - each.points_m[i])
            if np.isfinite(length):
                lengths.append(length)
                weights.append(1.0 / (each.covariance_m2[i, 0] + each.covariance_m2[j, 0]))
        # The median minimizes the sum of weighted absolute deviations, at one of the values.
        costs = [np.dot(weights, np.abs(np.array(lengths) - each)) for each in lengths]
        assert np.dot(weights, np.abs(np.array(lengths) - medians[b])) == pytest.approx(min(costs), rel=1e-9)
        assert variances[b] == pytest.approx(len(weights) / sum(weights), rel=1e-9)


def test_an_outlier_hardly_changes_the_lengths(rng: np.random.Generator) -> None:
    seen = buffer(rng, person(rng), 9)
    before = fit_shape(seen, SETTINGS)[0]
    seen[4].points_m[SKELETON.index("left_wrist")] += 1.5
    np.testing.assert_allclose(fit_shape(seen, SETTINGS)[0], before, atol=0.015)


@pytest.mark.parametrize("weight", [0.3, 1.0, 10.0])
def test_lengths_minimize_the_equation(weight: float, rng: np.random.Generator) -> None:
    """Sum of omega (l(beta) - l)^2 + lambda |beta - beta_0|^2, minimized without derivatives of the limbs."""
    settings = settings_with(shape_weight=weight)
    seen = buffer(rng, person(rng, 1.1))
    medians, variances = measured_limbs(seen, LIMBS)
    omega = 1.0 / (variances + 2.0 * settings.options.model_floor_m**2)
    precision = np.linalg.inv(TREE.shape_covariance)
    place = {name: i for i, name in enumerate(TREE.shape_names)}

    def length(b: int, beta: np.ndarray) -> float:
        names = [SKELETON.keypoints[k] for k in LIMBS.keypoints[b]]
        if names == ["left_shoulder", "right_shoulder"]:
            return 2.0 * abs(beta[place["left_shoulder.left"]])
        if names == ["left_hip", "right_hip"]:
            return 2.0 * abs(beta[place["left_hip.left"]])
        return float(beta[place[names[1].replace("right", "left")]])

    def cost(beta: np.ndarray) -> float:
        prior = beta - TREE.shape_m
        measured = sum(omega[b] * (length(b, beta) - medians[b]) ** 2 for b in range(len(LIMBS)))
        return float(measured + weight * prior @ precision @ prior)

    shape, covariance = fit_shape(seen, settings)
    expected = minimize(cost, TREE.shape_m, method="BFGS", options={"gtol": 1e-8}).x
    np.testing.assert_allclose(shape, expected, atol=1e-4)
    assert cost(shape) <= cost(expected) + 1e-6
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()


def test_a_large_prior_weight_keeps_the_mean(rng: np.random.Generator) -> None:
    seen = buffer(rng, person(rng, 1.15), sd_m=0.002)
    free, stiff = (fit_shape(seen, settings_with(shape_weight=weight))[0] for weight in (0.01, 1e6))
    np.testing.assert_allclose(stiff, TREE.shape_m, atol=1e-4)
    limbs = LIMBS.lengths_m(TREE, free) / LIMBS.lengths_m(TREE, TREE.shape_m)
    np.testing.assert_allclose(limbs, 1.15, atol=0.03)


def limit_cost(state: State) -> float:
    """Return phi_lim: half the sum of squared violations of the joint limits."""
    total, turns, bones = 0.0, state.turns[0], state.bones[0]
    for limit in TREE.limits:
        axis = turns[limit.segment] @ np.array(limit.axis)
        if limit.kind == 0:
            value = np.cross(axis, bones[limit.before][:, 2]) @ bones[limit.bone][:, 2]
        elif limit.kind == 1:
            value = axis @ bones[limit.bone][:, 2]
        else:
            value = (turns[limit.bone] @ np.array(limit.axis)) @ axis
        total += max(0.0, limit.least - value) ** 2
    return 0.5 * total


def moved(state: State, change: np.ndarray) -> State:
    out, segments = select_states(state, [0]), len(TREE.segments)
    out.root[0] += change[:3]
    turns = Rotation.from_rotvec(change[3 : 3 + 3 * segments].reshape(-1, 3)).as_matrix()
    out.turns[0] = out.turns[0] @ turns
    bends = np.zeros((len(TREE.bones), 3))
    bends[:, :2] = change[3 + 3 * segments :].reshape(-1, 2)
    out.bones[0] = out.bones[0] @ Rotation.from_rotvec(bends).as_matrix()
    return out


def pose_cost(change: np.ndarray, state: State, points: np.ndarray) -> float:
    """Return the cost of a pose: distances of the core and violations of joint limits, term by term."""
    other, options = moved(state, change), SETTINGS.options
    distances = float(((points_of(other) - points)[CORE] ** 2).sum())
    return 0.5 * distances / options.specification.core_fit_sd_m**2 + limit_cost(other) / options.limit_sigma**2


@pytest.mark.parametrize("bend", [0.2, 0.9])
def test_pose_minimizes_the_equation(bend: float) -> None:
    """Sum over the core of |FK - X|^2 + lambda_lim phi_lim: its slope is zero, and a direct search finds no less."""
    violations = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        points = points_of(person(rng, bend=bend)) + 0.03 * rng.normal(size=(len(SKELETON), 3))
        state = fit_core_pose(points, np.asarray(TREE.shape_m), SETTINGS)
        steps, start = 1e-6 * np.eye(TREE.n_pose), np.zeros(TREE.n_pose)
        slope = [(pose_cost(h, state, points) - pose_cost(-h, state, points)) / 2e-6 for h in steps]
        np.testing.assert_allclose(slope, 0.0, atol=1e-3)
        best = minimize(pose_cost, start, (state, points), method="BFGS", options={"maxiter": 5}).fun
        assert pose_cost(start, state, points) <= best + 1e-6
        violations.append(limit_cost(state))
    assert (max(violations) > 1e-4) == (bend > 0.5)


def test_a_pose_within_the_limits_is_found_exactly() -> None:
    people = (person(np.random.default_rng(seed), bend=0.2) for seed in range(20))
    true = next(each for each in people if limit_cost(each) == 0.0)
    state = fit_core_pose(points_of(true), true.shape[0], SETTINGS)
    np.testing.assert_allclose(points_of(state)[CORE], points_of(true)[CORE], atol=1e-4)


def test_first_body_has_the_velocity_of_the_buffer(rng: np.random.Generator) -> None:
    true, velocity = person(rng), np.array([0.8, -0.3, 0.0])
    seen = [observation(t, points_of(true) + t * velocity) for t in np.arange(0.0, 0.4, 0.04)]
    state, past, error = fit_first_body(seen, SETTINGS)
    np.testing.assert_allclose(state.velocity[0, :3], velocity, atol=0.02)
    np.testing.assert_allclose(points_of(state)[CORE], seen[-1].points_m[CORE], atol=0.03)
    assert len(past) == len(seen) - 1
    assert error < 2.0
    still = fit_first_body(seen, settings_with(tentative_motion=False))[0]
    np.testing.assert_array_equal(still.velocity[0, :3], 0.0)


def test_fit_of_the_promotion_can_be_switched_off(rng: np.random.Generator) -> None:
    """Without it, the body is filtered from the detections, and its lengths differ from the medians."""
    track = TentativeTrack(1, buffer(rng, person(rng, 1.1)))
    on, off = (
        specification.STRATEGY.initiation.fit(track, settings)[0]
        for settings in (SETTINGS, settings_with(promotion_fit=False))
    )
    np.testing.assert_allclose(on.shape[0], fit_shape(track.observations, SETTINGS)[0], rtol=1e-12)
    assert np.abs(on.shape[0] - off.shape[0]).max() > 1e-3
