"""Priors on posture and height for people whom a single view shows."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kernels.tracking.posture_statistics import lowest_point
from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import State
from posefuse.kernels.tracking.smoothing import apply_changes
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.cameras import UpAxis, up_vector
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from posefuse.synthetic.options import DetectorOptions
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import ProjectedBodies, join_states, select_states
from posefuse.tracking.records import RecentHistory
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.single_view_priors import (
    _lean_rows,
    apply_height_prior,
    apply_posture_prior,
    observe_height,
    observe_posture,
)
from tests.unit.tracking.stage_runs import (
    active_people,
    assert_equal_results,
    errors_m,
    frames_and_views,
    run_without,
    select_rows,
    tracker_without,
    true_points_m,
)

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


def empty_history(settings: TrackerSettings, people: int = 1) -> RecentHistory:
    tree = settings.tree
    return RecentHistory.new(people, 2, settings.n_groups, len(settings.skeleton), len(tree.segments) + len(tree.bones))


def axes_of(state: State) -> np.ndarray:
    return np.concatenate([state.turns[0, :, :, 2], state.bones[0, :, :, 2]])


def leans_of(state: State) -> np.ndarray:
    return axes_of(state) @ state.turns[0, 0, :, 2]


def rotated(state: State, by: Rotation) -> State:
    matrix = by.as_matrix()
    return select_states(state, [0])._replace(turns=matrix @ state.turns, bones=matrix @ state.bones)


def test_posture_statistics_are_mean_and_variance_of_leans(settings: TrackerSettings):
    recent, states = empty_history(settings), [tracked_person(settings, seed) for seed in range(6)]
    for state in states:
        observe_posture(state, recent, np.array([3]), DT_S, settings)
    leans = np.array([leans_of(state) for state in states])
    np.testing.assert_allclose(recent.leans[0], leans.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(recent.leans_variance[0], leans.var(axis=0), atol=1e-12)
    np.testing.assert_allclose(
        recent.trunk_axis[0], np.mean([axes_of(state)[0] for state in states], axis=0), atol=1e-12
    )
    assert recent.posture_observed_s[0] == pytest.approx(6 * DT_S)


def test_single_view_adds_no_posture_statistics(settings: TrackerSettings):
    recent = empty_history(settings, 2)
    observe_posture(
        join_states(tracked_person(settings, 0), tracked_person(settings, 1)), recent, np.array([1, 2]), DT_S, settings
    )
    assert recent.posture_observed_s.tolist() == [0.0, DT_S]
    assert not recent.leans[0].any()


def test_lean_jacobian_matches_finite_differences(settings: TrackerSettings):
    state, recent = tracked_person(settings, 3), empty_history(settings)
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
    state, recent = tracked_person(settings, 5), empty_history(settings)
    for _ in range(30):
        observe_posture(state, recent, np.array([2]), DT_S, settings)
    about = Rotation.from_rotvec(1.3 * state.turns[0, 0, :, 2])
    turned = rotated(state, about)
    apply_posture_prior(turned, recent, np.array([True]), DT_S, settings)
    np.testing.assert_allclose(turned.turns, rotated(state, about).turns, atol=1e-9)
    np.testing.assert_allclose(turned.bones, rotated(state, about).bones, atol=1e-9)


def test_posture_prior_corrects_leans_and_reduces_uncertainty(settings: TrackerSettings):
    before, recent = tracked_person(settings, 6), empty_history(settings)
    for _ in range(30):
        observe_posture(before, recent, np.array([2]), DT_S, settings)
    state = tracked_person(settings, 7)
    error_before, covariance = np.abs(leans_of(state) - leans_of(before)).mean(), state.covariance.copy()
    for _ in range(40):
        apply_posture_prior(state, recent, np.array([True]), DT_S, settings)
    assert np.abs(leans_of(state) - leans_of(before)).mean() < 0.3 * error_before
    n = settings.tree.n_pose
    assert np.linalg.eigvalsh(state.covariance[0, :n, :n]).min() > 0.0
    assert np.linalg.eigvalsh((covariance - state.covariance)[0, :n, :n]).min() > -1e-9


def test_posture_prior_needs_enough_history(settings: TrackerSettings):
    state, recent = tracked_person(settings, 8), empty_history(settings)
    observe_posture(tracked_person(settings, 9), recent, np.array([2]), DT_S, settings)
    unchanged = select_states(state, [0])
    apply_posture_prior(unchanged, recent, np.array([True]), DT_S, settings)
    np.testing.assert_array_equal(unchanged.bones, state.bones)
    np.testing.assert_array_equal(unchanged.covariance, state.covariance)


def settings_with_up(up: UpAxis | None) -> TrackerSettings:
    rig = replace(build_rig("ring", 2), up_axis=up)
    return TrackerSettings.of(rig, shipped_skeleton("body_20"), default_noise(rig, Options()), TrackerOptions())


def project(state: State, settings: TrackerSettings) -> ProjectedBodies:
    projected = ProjectedBodies.allocate(len(state.root), 0, len(settings.skeleton))
    project_people(settings.cameras[:0], settings.body, state, projected.arrays)
    return projected


def lowest_m(state: State, settings: TrackerSettings) -> float:
    return float(np.nanmin(project(state, settings).points_m @ np.array(up_vector(settings.rig.up_axis or "z"))))


@pytest.mark.parametrize("up", ["x", "-y", "z"])
def test_height_statistics_are_mean_and_variance_of_the_lowest_point(up: UpAxis):
    settings = settings_with_up(up)
    recent, states = empty_history(settings), [tracked_person(settings, seed) for seed in range(6)]
    for state in states:
        observe_height(project(state, settings), recent, np.array([3]), DT_S, settings)
    lows = np.array([lowest_m(state, settings) for state in states])
    assert recent.lowest_m[0] == pytest.approx(lows.mean(), abs=1e-12)
    assert recent.lowest_variance_m2[0] == pytest.approx(lows.var(), abs=1e-12)
    assert recent.height_observed_s[0] == pytest.approx(6 * DT_S)


def test_single_view_adds_no_height_statistics(settings: TrackerSettings):
    recent = empty_history(settings)
    observe_height(project(tracked_person(settings, 0), settings), recent, np.array([1]), DT_S, settings)
    assert not recent.height_observed_s.any()
    assert not recent.lowest_m.any()


def test_height_prior_needs_the_up_axis(settings: TrackerSettings):
    without_up, recent = settings_with_up(None), empty_history(settings)
    for _ in range(30):
        observe_height(project(tracked_person(settings, 0), settings), recent, np.array([2]), DT_S, settings)
    observed = empty_history(without_up)
    observe_height(project(tracked_person(without_up, 0), without_up), observed, np.array([2]), DT_S, without_up)
    assert not observed.height_observed_s.any()
    state = tracked_person(without_up, 1)
    unchanged = select_states(state, [0])
    apply_height_prior(unchanged, recent, np.array([True]), DT_S, without_up)
    np.testing.assert_array_equal(unchanged.root, state.root)


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
    state, recent = tracked_person(settings, 5), empty_history(settings)
    for _ in range(30):
        observe_height(project(state, settings), recent, np.array([2]), DT_S, settings)
    lowered = select_states(state, [0])
    lowered.root[0, 2] -= 0.5
    before = lowered.covariance.copy()
    for _ in range(20):
        apply_height_prior(lowered, recent, np.array([True]), DT_S, settings)
    assert abs(lowest_m(lowered, settings) - lowest_m(state, settings)) < 0.15
    n = settings.tree.n_pose
    assert np.linalg.eigvalsh(lowered.covariance[0, :n, :n]).min() > 0.0
    assert np.linalg.eigvalsh((before - lowered.covariance)[0, :n, :n]).min() > -1e-9


def test_height_prior_does_not_move_along_the_floor(settings: TrackerSettings):
    state, recent = tracked_person(settings, 6), empty_history(settings)
    for _ in range(30):
        observe_height(project(state, settings), recent, np.array([2]), DT_S, settings)
    shifted = select_states(state, [0])
    shifted.root[0, :2] += [2.0, -1.0]
    updated = select_states(shifted, [0])
    apply_height_prior(updated, recent, np.array([True]), DT_S, settings)
    np.testing.assert_allclose(updated.root, shifted.root, atol=1e-9)
    np.testing.assert_allclose(updated.bones, shifted.bones, atol=1e-9)


def test_height_prior_needs_enough_history(settings: TrackerSettings):
    state, recent = tracked_person(settings, 8), empty_history(settings)
    observe_height(project(tracked_person(settings, 9), settings), recent, np.array([2]), DT_S, settings)
    unchanged = select_states(state, [0])
    apply_height_prior(unchanged, recent, np.array([True]), DT_S, settings)
    np.testing.assert_array_equal(unchanged.covariance, state.covariance)


@pytest.fixture(scope="module")
def walk() -> CrowdScene:
    """Return a walking person in five views, with correlated errors as those of a real detector."""
    detector = DetectorOptions(outlier_share=0.0, miss_share=0.0, swap_share=0.0)
    return simulate_crowd(CrowdOptions(people=1, duration_s=4.4, seed=1, detector=detector, faults=NO_FAULTS))


def test_stage_holds_height_and_distance_in_a_single_view(walk: CrowdScene):
    """After 2.4 s only the first camera shows the person."""
    frame, view = frames_and_views(walk.detections)
    detections = select_rows(walk.detections, (frame < 60) | (view == 0))
    truth = true_points_m(walk)[:, 0]
    error, height_error = [], []
    for stages in ((), ("single_view",)):
        results = run_without(walk, *stages, detections=detections)
        lowest_m = [active_people(people)["person_1"].points_m[:, 2].min() for people in results[60:]]
        error.append(errors_m(results, "person_1", truth)[60:].mean())
        height_error.append(np.abs(lowest_m - truth[60:, :, 2].min(axis=1)).mean())
    assert error[0] < 0.5 * error[1]
    assert height_error[0] < 0.05 < 0.1 < height_error[1]


def test_disabled_stage_collects_no_statistics(walk: CrowdScene):
    for stages in ((), ("single_view",)):
        tracker = tracker_without(walk, *stages)
        for i in range(20):
            tracker.update(Frame.of(walk.detections, i))
        recent = tracker.confirmed.recent
        assert (recent.posture_observed_s > 0.0).all() == (not stages)
        assert (recent.height_observed_s > 0.0).all() == (not stages)


def test_stage_does_not_change_people_in_several_views(walk: CrowdScene):
    assert_equal_results(run_without(walk), run_without(walk, "single_view"))
