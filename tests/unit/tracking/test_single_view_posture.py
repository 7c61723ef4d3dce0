"""Posture prior for people whom a single view shows."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kernels.tracking.records import State
from posefuse.kernels.tracking.smoothing import apply_changes
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.people import default_noise
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import join_states, select_states
from posefuse.tracking.records import RecentHistory
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.single_view_priors import _lean_rows, apply_posture_prior, observe_posture

DT_S = 0.04


@pytest.fixture(scope="module")
def settings() -> TrackerSettings:
    rig = build_rig("ring", 2)
    return TrackerSettings.of(rig, shipped_skeleton("body_20"), default_noise(rig, Options()), TrackerOptions())


def tracked_person(settings: TrackerSettings, seed: int) -> State:
    """Return a random pose, 0.3 rad from rest in each parameter."""
    tree, rng = settings.tree, np.random.default_rng(seed)
    points = np.full((len(settings.skeleton), 3), np.nan)
    points[settings.skeleton.index("mid_hip")] = [0.0, 0.0, 0.9]
    shape = np.asarray(tree.shape_m)
    state = initial_state(tree, points, shape, tree.shape_covariance, settings.options.motion)
    change = np.zeros((1, state.covariance.shape[1]))
    change[0, : tree.n_pose] = 0.3 * rng.normal(size=tree.n_pose)
    apply_changes(change, state)
    return state


def nothing_known(settings: TrackerSettings, people: int) -> RecentHistory:
    tree = settings.tree
    return RecentHistory.new(people, 2, settings.n_groups, len(settings.skeleton), len(tree.segments) + len(tree.bones))


def axes_of(state: State) -> np.ndarray:
    return np.concatenate([state.turns[0, :, :, 2], state.bones[0, :, :, 2]])


def leans_of(state: State) -> np.ndarray:
    return axes_of(state) @ state.turns[0, 0, :, 2]


def turned_round(state: State, by: Rotation) -> State:
    matrix = by.as_matrix()
    return select_states(state, [0])._replace(turns=matrix @ state.turns, bones=matrix @ state.bones)


def test_posture_statistics_are_mean_and_variance_of_leans(settings: TrackerSettings):
    recent, shown = nothing_known(settings, 1), [tracked_person(settings, seed) for seed in range(6)]
    for state in shown:
        observe_posture(state, recent, np.array([3]), DT_S, settings)
    leans = np.array([leans_of(state) for state in shown])
    np.testing.assert_allclose(recent.leans[0], leans.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(recent.leans_variance[0], leans.var(axis=0), atol=1e-12)
    np.testing.assert_allclose(
        recent.trunk_axis[0], np.mean([axes_of(state)[0] for state in shown], axis=0), atol=1e-12
    )
    assert recent.posture_observed_s[0] == pytest.approx(6 * DT_S)


def test_single_view_adds_no_statistics(settings: TrackerSettings):
    recent = nothing_known(settings, 2)
    observe_posture(
        join_states(tracked_person(settings, 0), tracked_person(settings, 1)), recent, np.array([1, 2]), DT_S, settings
    )
    assert recent.posture_observed_s.tolist() == [0.0, DT_S]
    assert not recent.leans[0].any()


def test_lean_jacobian_matches_finite_differences(settings: TrackerSettings):
    state, recent = tracked_person(settings, 3), nothing_known(settings, 1)
    observe_posture(tracked_person(settings, 4), recent, np.array([2]), DT_S, settings)
    rows, _, _ = _lean_rows(state, recent, 0, 0.1)
    for c in range(settings.tree.n_pose):
        change = np.zeros((1, state.covariance.shape[1]))
        change[0, c] = 1e-6
        moved = select_states(state, [0])
        apply_changes(change, moved)
        np.testing.assert_allclose((leans_of(moved) - leans_of(state))[1:] / 1e-6, rows[2:, c], atol=1e-5)


def test_posture_prior_is_invariant_to_heading(settings: TrackerSettings):
    """Leans are relative to the trunk, and the trunk's to the up axis, so that heading does not matter."""
    state, recent = tracked_person(settings, 5), nothing_known(settings, 1)
    for _ in range(30):
        observe_posture(state, recent, np.array([2]), DT_S, settings)
    about = Rotation.from_rotvec(1.3 * state.turns[0, 0, :, 2])
    turned = turned_round(state, about)
    apply_posture_prior(turned, recent, np.array([True]), DT_S, settings)
    np.testing.assert_allclose(turned.turns, turned_round(state, about).turns, atol=1e-9)
    np.testing.assert_allclose(turned.bones, turned_round(state, about).bones, atol=1e-9)


def test_posture_prior_corrects_leans_and_reduces_uncertainty(settings: TrackerSettings):
    before, recent = tracked_person(settings, 6), nothing_known(settings, 1)
    for _ in range(30):
        observe_posture(before, recent, np.array([2]), DT_S, settings)
    state = tracked_person(settings, 7)
    off, known = np.abs(leans_of(state) - leans_of(before)).mean(), state.covariance.copy()
    for _ in range(40):
        apply_posture_prior(state, recent, np.array([True]), DT_S, settings)
    assert np.abs(leans_of(state) - leans_of(before)).mean() < 0.3 * off
    n = settings.tree.n_pose
    assert np.linalg.eigvalsh(state.covariance[0, :n, :n]).min() > 0.0
    assert np.linalg.eigvalsh((known - state.covariance)[0, :n, :n]).min() > -1e-9


def test_prior_needs_enough_history(settings: TrackerSettings):
    state, recent = tracked_person(settings, 8), nothing_known(settings, 1)
    observe_posture(tracked_person(settings, 9), recent, np.array([2]), DT_S, settings)
    same = select_states(state, [0])
    apply_posture_prior(same, recent, np.array([True]), DT_S, settings)
    np.testing.assert_array_equal(same.bones, state.bones)
    np.testing.assert_array_equal(same.covariance, state.covariance)
