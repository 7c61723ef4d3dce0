"""Tempering of the information of correlated errors."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.kernels.tracking.records import State
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.backward_pass import smooth_states
from posefuse.tracking.body_states import empty_state, free_columns, join_states, select_states
from posefuse.tracking.settings import TrackerSettings, filter_memory_s, tempering_factor
from posefuse.tracking.tempering import bone_axes, predict_states, refilter, temper_first_state
from tests.reference import refiltering as reference
from tests.unit.tracking.test_smoothing import (
    close,
    filtered,
    keep_shape,
    observed,
    run_of,
    smooth_run,
    standing,
    times,
)

SKELETON = shipped_skeleton("body_20")
TREE = SKELETON.tree
N, H = TREE.n_pose, TREE.n_shape
DT_S = 0.04


@pytest.fixture(scope="module")
def settings() -> TrackerSettings:
    rig = build_rig("ring", 3)
    return TrackerSettings.of(rig, SKELETON, NoiseModel(np.full(3, 4.5), 1.0), TrackerOptions())


@pytest.mark.parametrize("kept_from", [8, 10**6])
def test_refilter_matches_the_dense_reference(settings, rng, kept_from):
    frames = 30
    states = filtered(settings, frames, rng, kept_from, turn=0.05)
    share, information_factor = rng.uniform(0.2, 1.0, (2, frames))
    first = temper_first_state(select_states(states, [0]), share[0], settings)
    arguments = states, times(frames), share, information_factor, first, settings
    (actual, information), (second, expected) = refilter(*arguments), reference.refilter(*arguments)
    close(actual, second, 1e-9)
    size = np.sqrt(np.einsum("kii,kjj->kij", np.abs(expected), np.abs(expected)))
    assert (np.abs(information - expected) <= 1e-7 * size + 1e-6 * np.abs(expected).max()).all()
    assert np.abs(information[1:]).max(axis=(1, 2)).min() > 0.0


def test_indefinite_covariance_is_refiltered_separately(settings, rng):
    """An indefinite covariance ends the compiled pass, which continues after that frame."""
    states = filtered(settings, 12, rng, turn=0.05)
    states.covariance[6, 3, 3] *= -1.0
    share, information_factor = np.full((2, 12), 0.5)
    first = temper_first_state(select_states(states, [0]), 0.5, settings)
    arguments = states, times(12), share, information_factor, first, settings
    actual, second = refilter(*arguments)[0], reference.refilter(*arguments)[0]
    close(select_states(actual, range(7)), select_states(second, range(7)), 1e-7)
    close(select_states(actual, [7]), select_states(states, [7]), 0.0)


@pytest.mark.parametrize("told_of_it", [0.9, 0.02])
def test_reinitialized_limb_leaves_valid_covariances(settings, rng, told_of_it):
    """This also holds for a small share of the information."""
    states = filtered(settings, 40, rng)
    limb = N - 2
    states.covariance[32, limb:N] = states.covariance[32, :, limb:N] = 0.0
    states.covariance[32, limb:N, limb:N] = 0.5 * np.eye(2)
    velocities = np.arange(N + H + limb, N + H + N)
    states.covariance[32, velocities] = states.covariance[32][:, velocities] = 0.0
    states.covariance[32, velocities, velocities] = 4.0
    share, information_factor, time_s = np.full(40, 0.3), np.full(40, 4.0), times(40)
    share[32] = told_of_it
    again, information = refilter(
        states,
        time_s,
        share,
        information_factor,
        temper_first_state(select_states(states, [0]), 0.3, settings),
        settings,
    )
    rows = free_columns(N, H, bool(states.free[0]))
    for each in (again, smooth_states(again, time_s, settings)):
        for covariance in each.covariance:
            np.linalg.cholesky(covariance[np.ix_(rows, rows)])
    assert (information[32] == 0.0).all()
    assert np.linalg.eigvalsh(information[1:]).min() > -1e-3 * np.abs(information).max()


def with_bones_turned(state: State, angles: np.ndarray) -> State:
    """Return the same state in bone frames that are turned about the bones."""
    out = select_states(state, np.arange(len(state.root)))
    whole = np.eye(2 * N + H)
    for b, angle in enumerate(angles):
        turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
        out.bones[:, b] = out.bones[:, b] @ turn
        for first in (0, N + H):
            c = first + N - 2 * len(angles) + 2 * b
            whole[c : c + 2, c : c + 2] = turn[:2, :2].T
    out.covariance[:] = whole @ out.covariance @ whole.T
    out.velocity[:] = out.velocity @ whole[N + H :, N + H :].T
    return out


@pytest.mark.parametrize("kept_from", [6, 10**6])
def test_information_does_not_depend_on_bone_frames(settings, rng, kept_from):
    """The bone frames of the second run differ by turns about the bones."""
    frames, angles = 12, rng.uniform(-3.0, 3.0, len(settings.tree.bones))
    variance = rng.uniform(0.02, 0.2, N + H) ** 2
    now, states = standing(settings), empty_state(settings.tree)
    for k in range(frames):
        if k:
            predict_states(now, np.array([DT_S]), settings)
        observed(now, rng.normal(0.0, 0.05, N + H), variance)
        if k == kept_from:
            keep_shape(now)
        states = join_states(states, now)
    share, t = np.full(frames, 0.4), times(frames)
    first = temper_first_state(select_states(states, [0]), share[0], settings)
    straight, messages = refilter(states, t, share, share, first, settings)
    turned, turned_said = refilter(states, t, share, share, with_bones_turned(first, angles), settings)
    close(turned, with_bones_turned(straight, angles), 1e-9)
    np.testing.assert_allclose(np.trace(messages, axis1=1, axis2=2), np.trace(turned_said, axis1=1, axis2=2), rtol=1e-6)


def test_covariances_are_transformed_between_bone_frames(settings, rng):
    """The information is the inverse covariance in both frames."""
    states, angles = filtered(settings, 5, rng), rng.uniform(-3.0, 3.0, len(settings.tree.bones))
    spread = np.diag(rng.uniform(0.5, 2.0, 2 * N + H))
    states.covariance[:] = spread @ states.covariance @ spread
    turned = with_bones_turned(states, angles)
    turn = bone_axes(turned, states, settings)
    actual, second = (np.linalg.inv(each.covariance[:, : N + H, : N + H]) for each in (turned, states))
    np.testing.assert_allclose(turn.transpose(0, 2, 1) @ second @ turn, actual, atol=1e-9 * np.abs(actual).max())
    assert np.abs(second - actual).max() > 1e-3 * np.abs(actual).max()


def test_frames_before_confirmation_use_the_plain_error_memory(settings, rng):
    """Initiation uses the error memory without a correction for the number of views."""
    states = filtered(settings, 15, rng)
    life = np.full(15, TrackState.ACTIVE, dtype=np.int8)
    life[:10] = TrackState.TENTATIVE
    run = run_of(states)
    before = smooth_run(replace(run, life=life), settings)
    five = replace(run, rows=np.zeros((15, 5), dtype=np.int64))
    rate = filter_memory_s(np.array([5]), np.zeros(1), np.array([DT_S]), replace(settings.options, error_memory_s=1.0))[
        0
    ]
    memory = settings.options.error_memory_s
    alike = replace(settings, options=replace(settings.options, error_memory_s=memory / rate))
    np.testing.assert_allclose(
        before.covariance_m2[:9], smooth_run(five, alike).covariance_m2[:9], rtol=0.05, atol=1e-6
    )
    np.testing.assert_allclose(before.points_m, smooth_run(five, alike).points_m, atol=2e-3)


@pytest.mark.parametrize("dt_s", [0.01, 0.04])
def test_tempering_equals_that_of_a_sum_of_correlated_errors(dt_s):
    """The variance of a long mean is that of the corresponding number of independent errors."""
    correlation = np.exp(-dt_s / 0.25)
    n = 200_000
    variance = (1.0 + 2.0 * np.sum(correlation ** np.arange(1, 10_000))) / n
    assert tempering_factor(np.array([dt_s]), 0.25)[0] / n == pytest.approx(variance, rel=1e-6)
