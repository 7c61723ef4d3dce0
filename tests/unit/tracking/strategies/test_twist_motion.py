"""Motion of the specification, against matrix exponentials, finite differences and integrals."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import select_states
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategies.twist_motion import TwistMotion, advance_root, cross_matrix, motion_over
from posefuse.tracking.track_set import advance_state

SKELETON = shipped_skeleton("body_20")
RIG = build_rig("ring", 4)
MOTION = TwistMotion()


def settings_with(**changed: Any) -> TrackerSettings:
    options = TrackerOptions(strategy="specification")
    options = replace(options, specification=replace(options.specification, **changed))
    return TrackerSettings.of(RIG, SKELETON, NoiseModel(np.full(4, 5.0), 1.0), options)


SETTINGS = settings_with()
TREE = SETTINGS.tree


def moving_person(rng: np.random.Generator) -> State:
    points = rng.normal(scale=0.5, size=(len(SKELETON), 3))
    state = initial_state(TREE, points, TREE.shape_m, TREE.shape_covariance, SETTINGS.options.motion)
    state.turns[0] = Rotation.random(len(TREE.segments), rng=rng).as_matrix()
    state.bones[0] = Rotation.random(len(TREE.bones), rng=rng).as_matrix()
    state.velocity[0] = rng.normal(size=TREE.n_pose)
    factor = 0.05 * rng.normal(size=state.covariance.shape[1:])
    state.covariance[0] = factor @ factor.T / len(factor)
    return state


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000), st.floats(0.0, 1.0))
def test_root_moves_by_the_matrix_exponential_of_its_twist(seed: int, dt_s: float) -> None:
    before = moving_person(np.random.default_rng(seed))
    after = select_states(before, [0])
    MOTION.advance(after, dt_s, SETTINGS)
    pose, twist = np.eye(4), np.zeros((4, 4))
    pose[:3, :3], pose[:3, 3] = before.turns[0, 0], before.root[0]
    twist[:3, :3] = cross_matrix(before.velocity[0, 3:6])
    twist[:3, 3] = before.turns[0, 0].T @ before.velocity[0, :3]
    expected = pose @ expm(dt_s * twist)
    np.testing.assert_allclose(after.turns[0, 0], expected[:3, :3], atol=1e-9)
    np.testing.assert_allclose(after.root[0], expected[:3, 3], atol=1e-9)
    # The twist itself persists.
    np.testing.assert_allclose(after.turns[0, 0].T @ after.velocity[0, :3], twist[:3, 3], atol=1e-9)
    np.testing.assert_array_equal(after.velocity[0, 3:], before.velocity[0, 3:])


def test_limbs_move_by_their_velocities(rng: np.random.Generator) -> None:
    before = moving_person(rng)
    after = select_states(before, [0])
    MOTION.advance(after, 0.1, SETTINGS)
    first = 3 + 3 * len(TREE.segments)
    for s in range(len(TREE.segments)):
        expected = before.turns[0, s] @ expm(cross_matrix(0.1 * before.velocity[0, 3 + 3 * s : 6 + 3 * s]))
        np.testing.assert_allclose(after.turns[0, s], expected, atol=1e-9)
    for b in range(len(TREE.bones)):
        bend = np.append(0.1 * before.velocity[0, first + 2 * b : first + 2 * b + 2], 0.0)
        np.testing.assert_allclose(after.bones[0, b], before.bones[0, b] @ expm(cross_matrix(bend)), atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000))
def test_derivatives_of_the_root_are_finite_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, velocity = Rotation.random(rng=rng).as_matrix(), 2.0 * rng.normal(size=6)
    decay, reach = np.repeat([0.9, 0.8], 3), np.repeat([0.1, 0.12], 3)

    def move(change: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        own_turn = turn @ Rotation.from_rotvec(change[3:6]).as_matrix()
        own = velocity + change[6:]
        path, speed, _ = advance_root(own_turn, own, decay, reach)
        turned = own_turn @ Rotation.from_rotvec(reach[3] * own[3:]).as_matrix()
        return change[:3] + path, turned, speed, decay[3:] * own[3:]

    block, h = advance_root(turn, velocity, decay, reach)[2], 1e-5
    for i, step in enumerate(h * np.eye(12)):
        (p1, r1, v1, w1), (p0, r0, v0, w0) = move(step), move(-step)
        twisted = Rotation.from_matrix(r0.T @ r1).as_rotvec()
        expected = np.concatenate([p1 - p0, twisted, v1 - v0, w1 - w0]) / (2.0 * h)
        np.testing.assert_allclose(block[:, i], expected, atol=1e-6)


def test_process_noise_is_that_of_integrated_accelerations() -> None:
    """A velocity that persists integrates white acceleration q: variances q dt, q dt^2 / 2 and q dt^3 / 3."""
    dt_s = 0.3
    _, reach, (position, between, speed) = motion_over(dt_s, SETTINGS)
    q = SETTINGS.power
    np.testing.assert_allclose(reach, dt_s)
    np.testing.assert_allclose(position, q * quad(lambda t: t**2, 0.0, dt_s)[0])
    np.testing.assert_allclose(between, q * quad(lambda t: t, 0.0, dt_s)[0])
    np.testing.assert_allclose(speed, q * dt_s)
    state, off = moving_person(np.random.default_rng(0)), settings_with(twist_motion=False)
    state.covariance[:] = 0.0
    MOTION.advance(state, dt_s, off)
    n, h = TREE.n_pose, TREE.n_shape
    np.testing.assert_allclose(np.diag(state.covariance[0])[:n], np.minimum(position, off.most))
    np.testing.assert_allclose(np.diag(state.covariance[0])[n + h :], speed)


def test_covariances_follow_the_transition(rng: np.random.Generator) -> None:
    state, plain = moving_person(rng), settings_with(twist_motion=False)
    before, dt_s = state.covariance[0].copy(), 0.05
    MOTION.advance(state, dt_s, plain)
    n = TREE.n_pose
    transition = np.eye(len(before))
    transition[np.arange(n), len(before) - n + np.arange(n)] = dt_s
    expected = transition @ before @ transition.T
    _, _, (position, _, _) = motion_over(dt_s, plain)
    np.testing.assert_allclose(state.covariance[0][0, 1:3], expected[0, 1:3], atol=1e-12)
    np.testing.assert_allclose(state.covariance[0][0, 0], expected[0, 0] + position[0], rtol=1e-9)


@pytest.mark.parametrize("dt_s", [-0.1, 0.0, 0.04, 0.4])
def test_without_both_terms_the_motion_is_the_default_one(dt_s: float, rng: np.random.Generator) -> None:
    off = settings_with(twist_motion=False, persistent_velocities=False)
    one, other = (select_states(moving_person(np.random.default_rng(1)), [0]) for _ in range(2))
    MOTION.advance(one, dt_s, off)
    advance_state(other, dt_s, off)
    for mine, theirs in zip(one, other, strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_a_twist_of_decaying_velocities_agrees_with_the_default_without_rotation(rng: np.random.Generator) -> None:
    """Without angular velocity of the root, a twist is a translation: the kernel is the twin."""
    fading = settings_with(persistent_velocities=False)
    state = moving_person(rng)
    state.velocity[0, 3:6] = 0.0
    one, other = select_states(state, [0]), select_states(state, [0])
    MOTION.advance(one, 0.1, fading)
    advance_state(other, 0.1, fading)
    for name in ("root", "turns", "bones", "velocity"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-9)


def test_switches_change_the_prediction() -> None:
    """A person who walks a curve: the twist bends the path, and persistent velocities lead farther."""
    ends = {}
    for twist in (False, True):
        for persistent in (False, True):
            state = moving_person(np.random.default_rng(2))
            state.velocity[0, :6] = [2.0, 0.0, 0.0, 0.0, 0.0, 2.0]
            start = state.root[0].copy()
            MOTION.advance(state, 0.5, settings_with(twist_motion=twist, persistent_velocities=persistent))
            ends[twist, persistent] = state.root[0] - start
    assert np.linalg.norm(ends[False, True]) == pytest.approx(1.0, rel=1e-9)
    assert np.linalg.norm(ends[False, False]) < 0.7
    assert np.linalg.norm(ends[True, True] - ends[False, True]) > 0.1
    assert np.linalg.norm(ends[True, True]) < np.linalg.norm(ends[False, True])
