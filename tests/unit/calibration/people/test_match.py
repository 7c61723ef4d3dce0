"""Approximate calibrations from people with simulated clocks, exchanged sides and unrelated cameras."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.people.match import match_views
from posefuse.errors import CalibrationError
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import angle_deg, filmed_person, pose_errors

RIG = build_rig("corners", 4)


def with_sides_exchanged(people, view, share):
    """Return the observations with left and right of one view exchanged in the first frames."""
    tracks = people.views[view]
    exchanged = np.arange(len(tracks.time_s)) < share * len(tracks.time_s)
    pixels = np.where(
        exchanged[:, None, None, None], tracks.keypoints_px[:, :, people.skeleton.mirror], tracks.keypoints_px
    )
    views = list(people.views)
    views[view] = replace(tracks, keypoints_px=pixels)
    return replace(people, views=tuple(views))


@pytest.mark.parametrize("layout", ["ring", "corners", "aisle"])
def test_poses_and_scale_of_synchronized_views(rng, layout):
    rig = build_rig(layout, 4)
    matched = match_views(filmed_person(rig, rng))
    rotations_deg, centers_m, scale = pose_errors(rig, matched)
    assert np.median(rotations_deg) < 1.0
    assert np.median(centers_m) < 0.08
    assert scale == pytest.approx(1.0, abs=0.1)
    assert not matched.left_out
    np.testing.assert_allclose(matched.offset_s, 0.0, atol=0.02)


def test_time_offsets_and_different_rates(rng):
    offsets_s = (0.0, 0.9, -0.7, 0.3)
    people = filmed_person(RIG, rng, offsets_s=offsets_s, rates_hz=(30.0, 25.0, 50.0, 30.0))
    matched = match_views(people)
    assert np.median(pose_errors(RIG, matched)[0]) < 1.5
    np.testing.assert_allclose(matched.offset_s, offsets_s, atol=0.02)


def test_views_that_start_seconds_apart(rng):
    offsets_s = (0.0, 3.0, -1.5, 1.0)
    people = filmed_person(RIG, rng, duration_s=12.0, offsets_s=offsets_s, rates_hz=(30.0, 25.0, 60.0, 30.0))
    matched = match_views(replace(people, max_offset_s=6.0))
    assert np.median(pose_errors(RIG, matched)[0]) < 1.5
    np.testing.assert_allclose(matched.offset_s, offsets_s, atol=0.02)


def test_exchanged_sides_are_corrected(rng):
    people = filmed_person(RIG, rng)
    matched = match_views(with_sides_exchanged(people, 2, 0.33))
    assert np.median(pose_errors(RIG, matched)[0]) < 1.0
    assert np.abs(matched.views[2].keypoints_px - people.views[2].keypoints_px).max() == 0.0
    assert any("cam_2: left and right were exchanged in 3" in note for note in matched.notes)


def test_unknown_focal_lengths(rng):
    people = filmed_person(RIG, rng)
    views = []
    for view in people.views:
        matrix = view.camera.matrix.copy()
        matrix[:2, :2] *= 1.3
        views.append(replace(view, camera=replace(view.camera, matrix=matrix), focal_known=False))
    matched = match_views(replace(people, views=tuple(views)))
    focal = np.array([view.camera.matrix[0, 0] for view in matched.views])
    np.testing.assert_allclose(focal, 1200.0, rtol=0.08)
    assert np.median(pose_errors(RIG, matched)[0]) < 1.5


def test_unrelated_camera_is_left_out(rng):
    people = filmed_person(RIG, rng)
    other = filmed_person(RIG, np.random.default_rng(5), activities=("sit", "jump", "walk"))
    matched = match_views(replace(people, views=(*people.views[:3], other.views[3])))
    assert list(matched.left_out) == ["cam_3"]
    assert np.median(pose_errors(RIG.select(RIG.names[:3]), matched)[0]) < 1.5


def test_two_groups_are_named(rng):
    rig = build_rig("corners", 5)
    people = filmed_person(rig, rng)
    other = filmed_person(rig, np.random.default_rng(5), activities=("sit", "jump", "walk"))
    with pytest.raises(CalibrationError, match=r"\(cam_0, cam_1, cam_2\) and \(cam_3, cam_4\)"):
        match_views(replace(people, views=(*people.views[:3], *other.views[3:])))


def test_camera_without_detections_is_left_out(rng):
    people = filmed_person(RIG, rng)
    empty = replace(people.views[1], keypoints_px=np.full_like(people.views[1].keypoints_px, np.nan))
    matched = match_views(replace(people, views=(people.views[0], empty, *people.views[2:])))
    assert "0 frames" in matched.left_out["cam_1"]
    assert [view.camera.name for view in matched.views] == ["cam_0", "cam_2", "cam_3"]


def test_one_camera_with_detections_is_an_error(rng):
    people = filmed_person(RIG, rng)
    empty = [replace(view, keypoints_px=np.full_like(view.keypoints_px, np.nan)) for view in people.views[1:]]
    with pytest.raises(CalibrationError, match="by 1 of the 4 cameras; two are needed"):
        match_views(replace(people, views=(people.views[0], *empty)))


def test_standing_still_is_an_error(rng):
    people = filmed_person(RIG, rng, sigma_px=1.0)
    still = [
        replace(view, keypoints_px=np.repeat(view.keypoints_px[:1], len(view.time_s), axis=0)) for view in people.views
    ]
    with pytest.raises(CalibrationError, match="stand still"):
        match_views(replace(people, views=tuple(still)))


def test_cameras_at_one_place_are_an_error(rng):
    first = RIG.cameras[0]
    turned = first.camera_from_world.copy()
    turn = np.array([[np.cos(0.1), 0.0, np.sin(0.1)], [0.0, 1.0, 0.0], [-np.sin(0.1), 0.0, np.cos(0.1)]])
    turned[:3] = turn @ turned[:3]
    rig = replace(RIG, cameras=(first, replace(RIG.cameras[1], camera_from_world=turned)))
    with pytest.raises(CalibrationError, match="from the same place"):
        match_views(filmed_person(rig, rng, sigma_px=1.0))


def test_same_input_gives_same_result(rng):
    people = filmed_person(RIG, rng, duration_s=4.0)
    first, second = match_views(people), match_views(people)
    for a, b in zip(first.views, second.views, strict=True):
        assert a.camera == b.camera
    assert first.offset_s.tobytes() == second.offset_s.tobytes()


def test_two_views(rng):
    rig = build_rig("ring", 4).select(["cam_0", "cam_1"])
    matched = match_views(filmed_person(rig, rng, duration_s=10.0))
    a, b = (view.camera.rotation for view in matched.views)
    assert angle_deg(b @ a.T, rig.cameras[1].rotation @ rig.cameras[0].rotation.T) < 3.0


@pytest.mark.parametrize("seed", [20, 21])
def test_synchronized_views_of_periodic_motion_stay_synchronized(seed):
    """A walk is nearly the same half a gait cycle later, elsewhere; a whole cycle is more than the bound."""
    people = filmed_person(
        build_rig("aisle", 4), np.random.default_rng(seed), activities=("walk",), duration_s=6.0, sigma_px=12.0
    )
    np.testing.assert_allclose(match_views(replace(people, max_offset_s=0.9)).offset_s, 0.0, atol=0.05)


def test_wrong_frame_rate_is_found(rng):
    people = filmed_person(RIG, rng, rates_hz=(30.0, 30.0, 25.0, 30.0), offsets_s=(0.0, 0.0, 0.6, 0.0), duration_s=10.0)
    # The file of the third camera states 30 frames per second instead of 25.
    wrong = replace(people.views[2], time_s=people.views[2].time_s * (25.0 / 30.0))
    matched = match_views(replace(people, views=(*people.views[:2], wrong, people.views[3])))
    np.testing.assert_allclose(matched.rate, [1.0, 1.0, 1.2, 1.0])
    np.testing.assert_allclose(matched.offset_s, [0.0, 0.0, 0.6, 0.0], atol=0.03)
    assert np.median(pose_errors(RIG, matched)[0]) < 1.5
    assert any("cam_2: its frame rate is 0.833 times as high as stated" in note for note in matched.notes)
