"""Termination of lost tracks."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import OptionsError
from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import initial_state
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import PartOptions, TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import ProjectedBodies, join_states
from posefuse.tracking.lifecycle import (
    LifecycleThresholds,
    fix_shape,
    new_track,
    swap_identities,
    tracks_to_terminate,
    update_last_inside,
)
from posefuse.tracking.records import Track
from posefuse.tracking.settings import TrackerSettings

BOUNDS = LifecycleThresholds(3.0, -2.0, 3.0)
SKELETON = shipped_skeleton("body_20")
RIG = build_rig("ring", 3)


def settings_with(**options: float) -> TrackerSettings:
    return TrackerSettings.of(RIG, SKELETON, NoiseModel(np.full(3, 5.0), 1.0), replace(TrackerOptions(), **options))


def tracked_person(settings: TrackerSettings, state: TrackState) -> tuple[Track, State]:
    """Return a track last seen at 0 s, and its state with a root uncertainty of 0.5 m."""
    tree = settings.tree
    points = np.full((len(SKELETON), 3), np.nan)
    points[SKELETON.index("mid_hip")] = [0.0, 0.0, 0.9]
    body = initial_state(
        tree, points, np.asarray(tree.shape_m), np.asarray(tree.shape_covariance), settings.options.motion
    )
    body.covariance[0, :3, :3] = np.eye(3) * 0.25 / 3.0
    track = new_track(1, 0.0, BOUNDS)
    track.state, track.last_inside_s = state, 0.0
    return track, body


@pytest.mark.parametrize(
    ("options", "time_s", "why"),
    [
        ({}, 29.0, None),
        ({}, 31.0, "lost for 31.0 s"),
        ({"terminate_beyond_m": 0.6}, 1.0, None),
        ({"terminate_beyond_m": 0.4}, 1.0, "position uncertainty of 0.5 m"),
        ({"terminate_outside_after_s": 2.0}, 1.9, None),
        ({"terminate_outside_after_s": 2.0}, 2.1, "outside the overlap of two cameras for 2.1 s"),
    ],
)
def test_lost_tracks_terminate_by_time_uncertainty_and_position(options, time_s, why):
    settings = settings_with(**options)
    track, body = tracked_person(settings, TrackState.LOST)
    assert tracks_to_terminate([track], body, time_s, settings) == ({} if why is None else {0: why})


def test_active_tracks_do_not_terminate():
    settings = settings_with(terminate_beyond_m=0.1, terminate_outside_after_s=0.1)
    track, body = tracked_person(settings, TrackState.ACTIVE)
    assert tracks_to_terminate([track], body, 100.0, settings) == {}


@pytest.mark.parametrize(("x_m", "inside"), [(0.0, True), (3.0, True), (30.0, False)])
def test_inside_is_where_two_views_overlap(x_m, inside):
    settings = settings_with(terminate_outside_after_s=1.0)
    track, body = tracked_person(settings, TrackState.LOST)
    body.root[0, 0] = x_m
    projected = ProjectedBodies.allocate(1, len(RIG), len(SKELETON))
    project_people(settings.cameras, settings.body, body, projected.arrays)
    update_last_inside([track], projected, 5.0, settings)
    assert (track.last_inside_s == 5.0) == inside


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("initiate_share", -3.0, "finite number from 0 to 1, got -3"),
        ("initiate_share", 7.0, "finite number from 0 to 1, got 7"),
        ("anchor_sd_m", np.nan, "finite number"),
    ],
)
def test_options_of_parts_are_checked(name, value, words):
    with pytest.raises(OptionsError, match=rf"tracker.parts.{name} .*{words}"):
        PartOptions(**{name: value})


def test_limits_are_positive():
    for name in ("terminate_beyond_m", "terminate_outside_after_s"):
        with pytest.raises(OptionsError, match=f"tracker.{name} must be a finite number above 0 .*got 0"):
            replace(TrackerOptions(), **{name: 0.0})


def test_half_of_few_keypoints_support_a_person():
    assert settings_with().options.min_joints == 4
    assert settings_with(min_joints=30).options.min_joints == 10


def test_bone_lengths_follow_the_name_after_an_identity_swap():
    """One shape is fixed and one is free; both stay so, and covariances stay valid."""
    settings = settings_with()
    (one, first), (other, second) = (tracked_person(settings, TrackState.ACTIVE) for _ in range(2))
    other.number, other.name = 2, "person_2"
    state = join_states(first, second)
    state.shape[1] *= 1.1
    state.root[1] += 1.0
    one.last_multiview_s = 1e3
    fix_shape(one, state, 0, 1e3, 1e3, settings)
    roots, shapes, covariance = state.root.copy(), state.shape.copy(), state.covariance.copy()
    n, h = settings.tree.n_pose, settings.tree.n_shape
    swap_identities([one, other], state, 0, 1)
    assert [(t.number, t.name, t.known_shape is not None, t.shape_observed_s) for t in (one, other)] == [
        (1, "person_2", False, 0.0),
        (2, "person_1", True, 1e3),
    ]
    np.testing.assert_array_equal(state.root, roots)
    np.testing.assert_array_equal(state.shape, shapes[::-1])
    np.testing.assert_array_equal(state.free, [1, 0])
    lengths = slice(n, n + h)
    np.testing.assert_array_equal(state.covariance[0, lengths, lengths], covariance[1, lengths, lengths])
    assert not state.covariance[1, lengths].any()
    np.testing.assert_array_equal(state.covariance[:, :n, :n], covariance[:, :n, :n])
    np.linalg.cholesky(state.covariance[0])
