"""When somebody who is lost is not looked for any more."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import OptionsError
from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import State
from posefuse.kinematics.initial_pose import newborn
from posefuse.model.noise import NoiseModel
from posefuse.model.options.tracker import PartOptions, TrackerOptions
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig
from posefuse.tracking.body_states import Sight
from posefuse.tracking.lifecycle import Bounds, forgotten, newcomer, note_inside
from posefuse.tracking.records import Track
from posefuse.tracking.settings import Settings

BOUNDS = Bounds(3.0, -2.0, 3.0)
SKELETON = shipped_skeleton("body_20")
RIG = build_rig("ring", 3)


def settings_with(**options: float) -> Settings:
    return Settings.of(RIG, SKELETON, NoiseModel(np.full(3, 5.0), 1.0), replace(TrackerOptions(), **options))


def somebody(settings: Settings, state: TrackState) -> tuple[Track, State]:
    """Somebody last seen at 0 s, whose root is known to 0.5 m."""
    tree = settings.tree
    points = np.full((len(SKELETON), 3), np.nan)
    points[SKELETON.index("mid_hip")] = [0.0, 0.0, 0.9]
    body = newborn(tree, points, np.asarray(tree.shape_m), np.asarray(tree.shape_covariance), settings.options.motion)
    body.covariance[0, :3, :3] = np.eye(3) * 0.25 / 3.0
    track = newcomer(1, 0.0, BOUNDS)
    track.state, track.inside_s = state, 0.0
    return track, body


@pytest.mark.parametrize(
    ("options", "time_s", "why"),
    [
        ({}, 29.0, None),
        ({}, 31.0, "lost for 31.0 s"),
        ({"forget_beyond_m": 0.6}, 1.0, None),
        ({"forget_beyond_m": 0.4}, 1.0, "where they are is known to 0.5 m only"),
        ({"outside_s": 2.0}, 1.9, None),
        ({"outside_s": 2.0}, 2.1, "outside of what two cameras see for 2.1 s"),
    ],
)
def test_the_lost_are_forgotten_by_time_by_doubt_and_outside(options, time_s, why):
    settings = settings_with(**options)
    track, body = somebody(settings, TrackState.LOST)
    assert forgotten([track], body, time_s, settings) == ({} if why is None else {0: why})


def test_who_is_followed_is_not_forgotten():
    settings = settings_with(forget_beyond_m=0.1, outside_s=0.1)
    track, body = somebody(settings, TrackState.ACTIVE)
    assert forgotten([track], body, 100.0, settings) == {}


@pytest.mark.parametrize(("x_m", "inside"), [(0.0, True), (3.0, True), (30.0, False)])
def test_inside_is_where_two_views_overlap(x_m, inside):
    settings = settings_with(outside_s=1.0)
    track, body = somebody(settings, TrackState.LOST)
    body.root[0, 0] = x_m
    sight = Sight.room(1, len(RIG), len(SKELETON))
    project_people(settings.cameras, settings.body, body, *sight.arrays)
    note_inside([track], sight, 5.0, settings)
    assert (track.inside_s == 5.0) == inside


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("begin_share", -3.0, "finite number of at least 0, got -3"),
        ("begin_share", 7.0, "is a share, at most 1, got 7"),
        ("anchor_sd_m", np.nan, "finite number"),
    ],
)
def test_options_of_parts_are_checked(name, value, words):
    with pytest.raises(OptionsError, match=rf"tracker.parts.{name} .*{words}"):
        PartOptions(**{name: value})


def test_limits_are_positive():
    for name in ("forget_beyond_m", "outside_s"):
        with pytest.raises(OptionsError, match=f"tracker.{name} must be positive, or left out, got 0"):
            replace(TrackerOptions(), **{name: 0.0})


def test_few_keypoints_support_somebody_by_half_of_them():
    assert settings_with().options.min_joints == 4
    assert settings_with(min_joints=30).options.min_joints == 10
