"""Reinitialization of directions and limbs."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.tracking import reinitialize
from posefuse.tracking.settings import TrackerSettings
from tests.unit.tracking.mice import MOUSE, RIG, SETTINGS, TREE, standing
from tests.unit.tracking.stage_runs import (
    active_people,
    assert_equal_results,
    clean_scene,
    errors_m,
    events_of,
    run_without,
    scene_of_points,
    true_points_m,
)


def test_long_gap_depends_on_how_far_limbs_turn() -> None:
    human = TrackerSettings.of(RIG, shipped_skeleton("body_20"), SETTINGS.noise, TrackerOptions())
    assert [reinitialize.is_long_gap(1.0 / rate_hz, SETTINGS) for rate_hz in (100, 30, 2)] == [False, False, True]
    assert [reinitialize.is_long_gap(1.0 / rate_hz, human) for rate_hz in (25, 5, 2)] == [False, False, True]


def test_directions_with_initial_variance_are_unknown() -> None:
    state = standing(np.zeros(3))
    columns = np.arange(TREE.n_pose)
    state.covariance[:, columns, columns] = SETTINGS.most
    assert reinitialize.has_unknown_directions(state, SETTINGS).all()
    state.covariance[:, columns, columns] = 0.1 * SETTINGS.most
    assert not reinitialize.has_unknown_directions(state, SETTINGS).any()


def test_reinitialized_bones_follow_their_points_and_others_stay() -> None:
    state, points = standing(np.zeros(3)), np.full((len(MOUSE), 3), np.nan)
    points[MOUSE.index("tail_base")], points[MOUSE.index("tail_middle")] = [0.0, 0.0, 0.0], [0.0, 0.02, 0.0]
    which = np.zeros(len(TREE.segments) + len(TREE.bones), dtype=bool)
    which[len(TREE.segments) :] = True
    before = state.bones.copy()
    reinitialize.reinitialize_directions(state, 0, which, points, SETTINGS)
    tail = TREE.bones.index("tail_middle")
    np.testing.assert_allclose(state.bones[0, tail, :, 2], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_array_equal(np.delete(state.bones[0], tail, axis=0), np.delete(before[0], tail, axis=0))


def test_stage_tracks_limbs_at_a_low_frame_rate() -> None:
    """At two frames per second the prediction does not constrain the directions of limbs."""
    scene = clean_scene(people=1, duration_s=12.0, seed=2, rate_hz=2.0)
    truth = true_points_m(scene)[:, 0]
    on, off = (errors_m(run_without(scene, *stages), "person_1", truth)[2:] for stages in ((), ("reinitialization",)))
    assert on.max() < 0.02
    assert off.mean() > 0.15
    assert off.max() > 0.4


def test_stage_reinitializes_a_leg_that_most_views_contradict() -> None:
    """The left leg points upwards from 2 s on, without a motion in between."""
    scene = clean_scene(people=1, duration_s=3.2, rate_hz=100.0)
    skeleton, points = scene.detections.skeleton, true_points_m(scene)
    hip, leg = skeleton.index("left_hip"), [skeleton.index(name) for name in ("left_knee", "left_ankle")]
    across = points[:, 0, hip] - points[:, 0, skeleton.index("right_hip")]
    half_turn = Rotation.from_rotvec(np.pi * across / np.linalg.norm(across, axis=1)[:, None])
    for k in leg:
        points[200:, 0, k] = points[200:, 0, hip] + half_turn[200:].apply((points[:, 0, k] - points[:, 0, hip])[200:])
    displaced = scene_of_points(points, scene)
    duration_s = []
    for stages in ((), ("reinitialization",)):
        results = run_without(displaced, *stages)
        error_m = [
            np.linalg.norm(active_people(people)["person_1"].points_m[leg] - truth[0, leg], axis=-1).mean()
            for people, truth in zip(results, points, strict=True)
            if people.number >= 200
        ]
        duration_s.append(np.count_nonzero(np.array(error_m) > 0.1) / 100.0)
        events = events_of(results, "limb_reinitialized")
        assert [event.time_s for event in events] == ([] if stages else [pytest.approx(2.2, abs=0.05)])
    assert duration_s[0] < 0.85 * duration_s[1]


def test_stage_does_not_change_predictable_motion() -> None:
    scene = clean_scene(people=2, duration_s=2.0)
    assert_equal_results(run_without(scene), run_without(scene, "reinitialization"))
