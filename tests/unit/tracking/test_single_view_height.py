"""Height prior for people whom a single view shows."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.kernels.tracking.posture_statistics import lowest_point
from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import State
from posefuse.kernels.tracking.smoothing import apply_changes
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.cameras import UpAxis, up_vector
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.people import default_noise
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import ProjectedBodies, select_states
from posefuse.tracking.records import RecentHistory
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.single_view_priors import apply_height_prior, observe_height

DT_S = 0.04


def settings_of(up: UpAxis | None = "z") -> TrackerSettings:
    rig = replace(build_rig("ring", 2), up_axis=up)
    return TrackerSettings.of(rig, shipped_skeleton("body_20"), default_noise(rig, Options()), TrackerOptions())


@pytest.fixture(scope="module")
def settings() -> TrackerSettings:
    return settings_of()


def tracked_person(settings: TrackerSettings, seed: int) -> State:
    """Return a random pose, 0.3 rad from rest in each parameter."""
    tree, rng = settings.tree, np.random.default_rng(seed)
    points = np.full((len(settings.skeleton), 3), np.nan)
    points[settings.skeleton.index("mid_hip")] = [0.0, 0.0, 0.9]
    state = initial_state(tree, points, np.asarray(tree.shape_m), tree.shape_covariance, settings.options.motion)
    change = np.zeros((1, state.covariance.shape[1]))
    change[0, : tree.n_pose] = 0.3 * rng.normal(size=tree.n_pose)
    apply_changes(change, state)
    return state


def sight_of(state: State, settings: TrackerSettings) -> ProjectedBodies:
    projected = ProjectedBodies.allocate(len(state.root), 0, len(settings.skeleton))
    project_people(settings.cameras[:0], settings.body, state, projected.arrays)
    return projected


def nothing_known(settings: TrackerSettings, people: int = 1) -> RecentHistory:
    tree = settings.tree
    return RecentHistory.new(people, 2, settings.n_groups, len(settings.skeleton), len(tree.segments) + len(tree.bones))


def lowest_m(state: State, settings: TrackerSettings) -> float:
    return float(np.nanmin(sight_of(state, settings).points_m @ np.array(up_vector(settings.rig.up_axis or "z"))))


@pytest.mark.parametrize("up", ["x", "-y", "z"])
def test_height_statistics_are_mean_and_variance_of_the_lowest_point(up: UpAxis):
    settings = settings_of(up)
    recent, shown = nothing_known(settings), [tracked_person(settings, seed) for seed in range(6)]
    for state in shown:
        observe_height(sight_of(state, settings), recent, np.array([3]), DT_S, settings)
    lows = np.array([lowest_m(state, settings) for state in shown])
    assert recent.lowest_m[0] == pytest.approx(lows.mean(), abs=1e-12)
    assert recent.lowest_variance_m2[0] == pytest.approx(lows.var(), abs=1e-12)
    assert recent.height_observed_s[0] == pytest.approx(6 * DT_S)


def test_single_view_adds_no_statistics(settings: TrackerSettings):
    recent = nothing_known(settings)
    observe_height(sight_of(tracked_person(settings, 0), settings), recent, np.array([1]), DT_S, settings)
    assert not recent.height_observed_s.any()
    assert not recent.lowest_m.any()


def test_height_prior_needs_the_up_axis(settings: TrackerSettings):
    nowhere, recent = settings_of(None), nothing_known(settings)
    for _ in range(30):
        observe_height(sight_of(tracked_person(settings, 0), settings), recent, np.array([2]), DT_S, settings)
    unknown = nothing_known(nowhere)
    observe_height(sight_of(tracked_person(nowhere, 0), nowhere), unknown, np.array([2]), DT_S, nowhere)
    assert not unknown.height_observed_s.any()
    state = tracked_person(nowhere, 1)
    same = select_states(state, [0])
    apply_height_prior(same, recent, np.array([True]), DT_S, nowhere)
    np.testing.assert_array_equal(same.root, state.root)


def test_height_jacobian_matches_finite_differences(settings: TrackerSettings):
    state, up, row = tracked_person(settings, 3), np.array([0.0, 0.0, 1.0]), np.empty(settings.tree.n_pose)
    assert lowest_point(settings.body, state, up, row) == pytest.approx(lowest_m(state, settings))
    for c in range(settings.tree.n_pose):
        change = np.zeros((1, state.covariance.shape[1]))
        change[0, c] = 1e-6
        moved = select_states(state, [0])
        apply_changes(change, moved)
        assert (lowest_m(moved, settings) - lowest_m(state, settings)) / 1e-6 == pytest.approx(row[c], abs=1e-5)


def test_height_prior_lifts_and_reduces_uncertainty(settings: TrackerSettings):
    state, recent = tracked_person(settings, 5), nothing_known(settings)
    for _ in range(30):
        observe_height(sight_of(state, settings), recent, np.array([2]), DT_S, settings)
    sunk = select_states(state, [0])
    sunk.root[0, 2] -= 0.5
    known = sunk.covariance.copy()
    for _ in range(20):
        apply_height_prior(sunk, recent, np.array([True]), DT_S, settings)
    assert abs(lowest_m(sunk, settings) - lowest_m(state, settings)) < 0.15
    n = settings.tree.n_pose
    assert np.linalg.eigvalsh(sunk.covariance[0, :n, :n]).min() > 0.0
    assert np.linalg.eigvalsh((known - sunk.covariance)[0, :n, :n]).min() > -1e-9


def test_height_prior_does_not_move_along_the_floor(settings: TrackerSettings):
    state, recent = tracked_person(settings, 6), nothing_known(settings)
    for _ in range(30):
        observe_height(sight_of(state, settings), recent, np.array([2]), DT_S, settings)
    gone = select_states(state, [0])
    gone.root[0, :2] += [2.0, -1.0]
    told = select_states(gone, [0])
    apply_height_prior(told, recent, np.array([True]), DT_S, settings)
    np.testing.assert_allclose(told.root, gone.root, atol=1e-9)
    np.testing.assert_allclose(told.bones, gone.bones, atol=1e-9)


def test_prior_needs_enough_history(settings: TrackerSettings):
    state, recent = tracked_person(settings, 8), nothing_known(settings)
    observe_height(sight_of(tracked_person(settings, 9), settings), recent, np.array([2]), DT_S, settings)
    same = select_states(state, [0])
    apply_height_prior(same, recent, np.array([True]), DT_S, settings)
    np.testing.assert_array_equal(same.covariance, state.covariance)
