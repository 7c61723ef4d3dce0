"""The smoother against dense textbook formulas, and smoothing in parts."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.kernels.tracking.records import State
from posefuse.kernels.tracking.smoothing import add_information, apply_changes, compare_states
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.backward_pass import smooth_in_place, smooth_states
from posefuse.tracking.body_states import empty_state, free_columns, join_states, select_states
from posefuse.tracking.refiltering import refilter_run
from posefuse.tracking.runs import Run
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.smoothed_bodies import SmoothedBodies, describe_bodies
from posefuse.tracking.tempering import predict_states, refilter, temper_first_state

SKELETON = shipped_skeleton("body_20")
TREE = SKELETON.tree
assert TREE is not None
N, H = TREE.n_pose, TREE.n_shape
DT_S = 0.04


@pytest.fixture(scope="module")
def settings() -> TrackerSettings:
    rig = build_rig("ring", 3)
    return TrackerSettings.of(rig, SKELETON, NoiseModel(np.full(3, 4.5), 1.0), TrackerOptions())


def standing(settings: TrackerSettings) -> State:
    points = np.array([(0.0, 0.0, 1.0)] * len(SKELETON)) + np.linspace(0.0, 0.3, 3 * len(SKELETON)).reshape(-1, 3)
    return initial_state(
        settings.tree, points, settings.tree.shape_m, settings.tree.shape_covariance, settings.options.motion
    )


def observed(state: State, change: np.ndarray, variance: np.ndarray) -> None:
    """Apply a textbook update, in place, by direct observations of pose and shape with an offset."""
    m = N + H if state.free[0] else N
    rows = free_columns(N, H, bool(state.free[0]))
    at = np.ix_(rows, rows)
    covariance = state.covariance[0][at]
    gain = covariance[:, :m] @ np.linalg.inv(covariance[:m, :m] + np.diag(variance[:m]))
    step = np.zeros((1, 2 * N + H))
    step[0, rows] = gain @ change[:m]
    apply_changes(step, state)
    left = covariance - gain @ covariance[:m]
    state.covariance[0][at] = 0.5 * (left + left.T)


def keep_shape(state: State) -> None:
    state.free[0] = 0
    state.covariance[0, N : N + H] = 0.0
    state.covariance[0, :, N : N + H] = 0.0


def filtered(
    settings: TrackerSettings, frames: int, rng: np.random.Generator, kept_from: int = 10**6, turn: float = 0.02
) -> State:
    """Return a person's filtered states with observations in all but a few frames."""
    now, out = standing(settings), empty_state(settings.tree)
    variance = np.full(N + H, turn**2)
    for k in range(frames):
        if k:
            predict_states(now, np.array([DT_S]), settings)
        if not 20 <= k < 25:
            observed(now, rng.normal(0.0, turn, N + H), variance)
        if k == kept_from:
            keep_shape(now)
        out = join_states(out, now)
    return out


def times(frames: int) -> np.ndarray:
    return DT_S * np.arange(frames)


def close(one: State, other: State, atol: float) -> None:
    for name, first, second in zip(State._fields, one, other, strict=True):
        np.testing.assert_allclose(first, second, atol=atol, err_msg=name)


def test_state_difference_inverts_the_update(settings, rng):
    start = select_states(standing(settings), [0, 0, 0])
    change = rng.normal(0.0, 0.5, (3, 2 * N + H))
    end = select_states(start, [0, 1, 2])
    apply_changes(change, end)
    actual = np.empty_like(change)
    compare_states(start, end, actual)
    np.testing.assert_allclose(actual, change, atol=1e-12)
    compare_states(end, start, actual)
    np.testing.assert_allclose(actual, -change, atol=1e-12)


def test_root_and_lengths_match_a_dense_smoother(settings, rng):
    """Smooth a body that only translates, whose model is linear, with one dense system."""
    frames = 12
    f = np.eye(2 * N + H)
    fade = np.exp(-DT_S / settings.decay_s)
    f[:N, N + H :] = np.diag(settings.decay_s * (1.0 - fade))
    f[N + H :, N + H :] = np.diag(fade)
    linear = np.r_[0:3, N : N + H, N + H : N + H + 3]
    at = np.ix_(linear, linear)
    states = filtered(settings, frames, rng)
    smooth = smooth_states(states, times(frames), settings)
    mean = np.concatenate([states.root, states.shape, states.velocity[:, :3]], axis=1)
    covariance = states.covariance[:, linear[:, None], linear]
    for k in range(frames - 2, -1, -1):
        q = predict_states(select_states(states, [k]), np.array([DT_S]), settings).covariance[0][at] - (
            f[at] @ covariance0(states, k, at) @ f[at].T
        )
        foretold = f[at] @ covariance0(states, k, at) @ f[at].T + q
        gain = covariance0(states, k, at) @ f[at].T @ np.linalg.inv(foretold)
        mean[k] = mean[k] + gain @ (mean[k + 1] - f[at] @ mean[k])
        covariance[k] = covariance0(states, k, at) + gain @ (covariance[k + 1] - foretold) @ gain.T
    np.testing.assert_allclose(smooth.root, mean[:, :3], atol=1e-9)
    np.testing.assert_allclose(smooth.shape, mean[:, 3 : 3 + H], atol=1e-9)
    np.testing.assert_allclose(smooth.velocity[:, :3], mean[:, 3 + H :], atol=1e-8)
    np.testing.assert_allclose(smooth.covariance[:, linear[:, None], linear], covariance, atol=1e-9)


def covariance0(states: State, k: int, at) -> np.ndarray:
    return states.covariance[k][at]


def smoothed_densely(states: State, time_s: np.ndarray, settings: TrackerSettings) -> np.ndarray:
    """Return the covariances of a smoother with one dense matrix."""
    covariance = states.covariance.copy()
    for k in range(len(time_s) - 2, -1, -1):
        dt_s = time_s[k + 1] - time_s[k]
        rows = free_columns(N, H, bool(states.free[k]))
        at = np.ix_(rows, rows)
        fade, f = np.exp(-dt_s / settings.decay_s), np.eye(2 * N + H)
        f[:N, N + H :], f[N + H :, N + H :] = np.diag(settings.decay_s * (1.0 - fade)), np.diag(fade)
        before, f = states.covariance[k][at], f[at]
        foretold = predict_states(select_states(states, [k]), np.array([dt_s]), settings).covariance[0][at]
        gain = np.linalg.solve(foretold, f @ before).T
        covariance[k][at] = before + gain @ (covariance[k + 1][at] - foretold) @ gain.T
    return covariance


@pytest.mark.parametrize("dt_s", [0.01, DT_S, 5.0])
@pytest.mark.parametrize("kept_from", [12, 10**6])
def test_covariances_match_a_dense_smoother(settings, rng, dt_s, kept_from):
    """The test includes gaps over which velocities fade."""
    settings = replace(settings, most=np.full(N, np.inf))
    states = filtered(settings, 20, rng, kept_from)
    smooth = smooth_states(states, dt_s * np.arange(20), settings)
    expected = smoothed_densely(states, dt_s * np.arange(20), settings)
    sd = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
    assert (np.abs(smooth.covariance - expected) <= 1e-7 * sd[:, :, None] * sd[:, None] + 1e-15).all()


@pytest.mark.parametrize("free", [0, 1])
def test_independent_information_reduces_covariances(settings, rng, free):
    states = filtered(settings, 6, rng, kept_from=10**6 if free else 0)
    root = rng.normal(0.0, 3.0, (6, N + H, N + H)) * (np.arange(N + H) < (N + H if free else N))
    information = root.transpose(0, 2, 1) @ root
    actual, m = states.covariance.copy(), N + H if free else N
    assert add_information(information, 0.3, states.free, N, actual) == 6
    expected = np.linalg.inv(states.covariance[:, :m, :m]) + 0.3 * information[:, :m, :m]
    np.testing.assert_allclose(actual[:, :m, :m] @ expected, np.tile(np.eye(m), (6, 1, 1)), atol=1e-6)
    actual[:, :m, :m] = states.covariance[:, :m, :m]
    np.testing.assert_array_equal(actual, states.covariance)
    actual[2, 0, 0] = -1.0
    assert add_information(information, 0.3, states.free, N, actual) == 2


def test_smoothing_reduces_covariances(settings, rng):
    states = filtered(settings, 40, rng, kept_from=30)
    smooth = smooth_states(states, times(40), settings)
    before = np.diagonal(states.covariance, axis1=1, axis2=2)
    after = np.diagonal(smooth.covariance, axis1=1, axis2=2)
    assert (after <= before * (1.0 + 1e-9) + 1e-15).all()
    assert (after[:30, :N] < before[:30, :N]).all()
    assert np.linalg.eigvalsh(smooth.covariance[5]).min() > -1e-12
    close(select_states(smooth, [39]), select_states(states, [39]), 0.0)


def test_last_frame_is_not_changed(settings, rng):
    """Predicted frames add no information about the last observed frame."""
    visible = filtered(settings, 12, rng)
    states, now = visible, select_states(visible, [11])
    for _ in range(6):
        predict_states(now, np.array([DT_S]), settings)
        states = join_states(states, now)
    smooth = smooth_states(states, times(18), settings)
    assert (np.diagonal(now.covariance[0])[:N] < settings.most).all()
    close(State(*(each[:12] for each in smooth)), smooth_states(visible, times(12), settings), 1e-8)
    close(State(*(each[12:] for each in smooth)), State(*(each[12:] for each in states)), 1e-8)


def test_fixed_shape_applies_to_all_frames(settings, rng):
    states = filtered(settings, 20, rng, kept_from=12)
    smooth = smooth_states(states, times(20), settings)
    assert np.abs(states.shape[0] - states.shape[-1]).max() > 1e-3
    # It wanders by so little in this time.
    np.testing.assert_allclose(smooth.shape, np.tile(states.shape[-1], (20, 1)), atol=1e-4)


def refilter_with_shares(states: State, share: np.ndarray, settings: TrackerSettings) -> State:
    first = temper_first_state(select_states(states, [0]), share[0], settings)
    return refilter(states, times(len(share)), share, np.ones(len(share)), first, settings)[0]


def test_refilter_with_all_information_returns_the_filter(settings, rng):
    states = filtered(settings, 40, rng, turn=0.005)
    close(refilter_with_shares(states, np.ones(40), settings), states, 1e-5)


def test_refilter_with_a_share_is_a_filter_with_more_noise(settings):
    """Half of the information equals twice the variance of the same observations."""
    frames = 15
    rng = np.random.default_rng(4)
    target = np.zeros(N + H)
    target[:3] = rng.normal(0.0, 0.05, 3)
    runs = []
    for factor in (1.0, 2.0):
        now, out = standing(settings), empty_state(settings.tree)
        fixed = select_states(now, [0])
        for k in range(frames):
            if k:
                predict_states(now, np.array([DT_S]), settings)
            change = np.empty((1, 2 * N + H))
            compare_states(now, fixed, change)
            observed(now, change[0, : N + H] + target * np.sin(0.3 * k), np.full(N + H, factor * 0.02**2))
            out = join_states(out, now)
        runs.append(out)
    again = refilter_with_shares(runs[0], np.full(frames, 0.5), settings)
    np.testing.assert_allclose(again.covariance, runs[1].covariance, atol=1e-8)
    np.testing.assert_allclose(again.root[5:], runs[1].root[5:], atol=3e-3)


def test_means_do_not_depend_on_covariances(settings, rng):
    states = filtered(settings, 30, rng)
    smooth = smooth_states(states, times(30), settings)
    means = select_states(states, np.arange(30))
    smooth_in_place(means, times(30), settings, means_only=True)
    for name in ("root", "turns", "bones", "shape", "velocity"):
        np.testing.assert_allclose(getattr(means, name), getattr(smooth, name), rtol=0, atol=1e-9)


def smooth_run(run: Run, settings: TrackerSettings) -> SmoothedBodies:
    """Return one person smoothed over all frames of a run."""
    window = refilter_run(run, None, settings)
    return describe_bodies(smooth_states(window.state, run.time_s, settings), window.information, settings)


def run_of(states: State, life: int = TrackState.ACTIVE) -> Run:
    frames = len(states.root)
    return Run(
        1, np.arange(frames), times(frames), True, states, np.zeros((frames, 3), dtype=np.int64),
        np.zeros((frames, 3, len(SKELETON)), dtype=bool), np.full(frames, life, dtype=np.int8), np.zeros(frames),
        np.full((frames, 3, len(SKELETON), 2), np.nan), np.full((frames, 3, len(SKELETON)), np.nan),
    )  # fmt: skip


def test_white_errors_need_no_tempering(settings, rng):
    """With the filter's error memory, the smoother is the plain smoother."""
    options = replace(settings.options, smoother_error_memory_s=1e-3)
    states = filtered(settings, 30, rng, turn=0.005)
    run = replace(run_of(states), fresh=False)
    smooth = smooth_run(run, replace(settings, options=options))
    plain = smooth_states(states, times(30), settings)
    np.testing.assert_allclose(smooth.root_m, plain.root, atol=1e-6)


def test_frame_after_a_gap_is_tempered_by_the_time_since_the_last_observation(settings, rng):
    """Before confirmation the filter tempers by that time, and the smoother corrects for it."""
    states = filtered(settings, 15, rng)
    missing_s = np.zeros(15)
    missing_s[8:10] = DT_S * np.arange(1, 3)
    run = replace(run_of(states, TrackState.TENTATIVE), missing_s=missing_s)
    spread = [
        smooth_run(each, settings).covariance_m2[12, :, 0] for each in (run, replace(run, missing_s=0.0 * missing_s))
    ]
    assert (spread[0] > spread[1]).all()


def test_missing_frames_have_larger_covariances(settings, rng):
    smooth = smooth_run(run_of(filtered(settings, 45, rng)), settings)
    spread = smooth.covariance_m2[:, :, [0, 3, 5]].sum(axis=-1)
    assert (spread[22] > spread[15]).all()
    assert (spread[22] > spread[30]).all()
    assert np.isfinite(smooth.points_m).all()


def test_smoothing_does_not_change_its_input(settings, rng):
    states = filtered(settings, 10, rng)
    kept = select_states(states, np.arange(10))
    smooth_run(run_of(states), settings)
    close(states, kept, 0.0)
