"""Simulated recordings for calibrations from people agree with their stated truth."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.calibration_recordings import staggered, without_focal
from benchmarks.simulated_rigs import PEOPLE, RigOptions, random_options, simulate_rig

from posefuse import Options, reconstruct
from posefuse.skeleton.skeletons import find_skeleton

FEW = RigOptions(cameras=3, duration_s=2.0, seed=3)


def test_seed_determines_the_bytes():
    again, other = simulate_rig(FEW), simulate_rig(replace(FEW, seed=4))
    pixels = simulate_rig(FEW).detections.keypoints_px
    assert again.detections.keypoints_px.tobytes() == pixels.tobytes()
    assert other.detections.keypoints_px.tobytes() != pixels.tobytes()


@pytest.mark.parametrize("people", PEOPLE)
def test_people_without_errors_are_reconstructed(people):
    case = simulate_rig(replace(FEW, people=people, noise=0.0))
    count = 1 if people != "several" else 2
    assert case.detections.people_counts.max() >= count
    if count == 1:
        layer = reconstruct(case.rig, case.detections, Options(solve="frame")).layers["measured"]
        assert np.nanmedian(layer.reprojection_error_px) < 1e-9


def test_offsets_and_rates_are_those_of_the_recording():
    case = simulate_rig(replace(FEW, noise=0.0, max_offset_s=1.0, rates_hz=(30.0, 25.0)))
    other = simulate_rig(replace(FEW, noise=0.0))
    assert case.rate_hz.tolist() == [30.0, 25.0, 30.0]
    assert np.nanmax(case.detections.time_s, axis=0) == pytest.approx([59 / 30, 49 / 25, 59 / 30])
    assert np.ptp(case.offset_s) > 0.05
    assert np.ptp(other.offset_s) == 0.0


def test_sides_of_one_view_are_swapped():
    longer = replace(FEW, noise=0.0, duration_s=10.0)
    case, straight = (simulate_rig(replace(longer, swap_share=share)) for share in (0.33, 0.0))
    mirror = np.asarray(find_skeleton(FEW.skeleton).mirror)
    ours, theirs = (np.asarray(each.detections.keypoints_px) for each in (case, straight))
    swapped = np.nanmax(np.abs(ours - theirs), axis=(1, 2)) > 1.0
    view = np.arange(len(ours)) % 3
    assert len(set(view[swapped].tolist())) == 1
    assert 0.02 < swapped.mean() < 0.25
    assert np.nanmax(np.abs(ours[swapped][:, mirror] - theirs[swapped])) < 1e-9


def test_unrelated_camera_is_named():
    case = simulate_rig(replace(FEW, unrelated=True))
    assert case.unrelated == ("cam_2",)


def test_trials_cover_the_stated_range():
    options = [random_options(seed) for seed in range(200)]
    assert {each.cameras for each in options} == set(range(2, 13))
    assert {each.layout for each in options} == {"ring", "corners", "aisle"}
    assert {each.people for each in options} == set(PEOPLE)
    assert max(each.swap_share for each in options) <= 1.0 / 3.0


def test_staggered_views_show_the_same_moments():
    case = simulate_rig(replace(FEW, noise=0.0))
    late = staggered(case, np.array([0.0, 0.5, 0.2]))
    assert late.offset_s == pytest.approx([0.0, 0.5, 0.2])
    ours, theirs = late.detections.frames(0, 1), case.detections
    np.testing.assert_array_equal(
        ours.views(["cam_1"]).keypoints_px, theirs.frames(15, 16).views(["cam_1"]).keypoints_px
    )
    assert late.detections.time_s[0].tolist() == [0.0, 0.0, 0.0]
    assert late.detections.n_frames == case.detections.n_frames - 15


def test_camera_without_focal_length_keeps_only_the_image_size():
    camera = simulate_rig(FEW).rig.cameras[0]
    guess = without_focal(camera)
    assert guess.matrix[0, 0] == max(camera.size_px)
    assert guess.matrix[:2, 2].tolist() == [(side - 1) / 2 for side in camera.size_px]


def test_principal_points_have_the_stated_spread_and_nothing_else_changes():
    many = replace(FEW, cameras=12)
    plain, moved = simulate_rig(many).rig, simulate_rig(replace(many, principal_sd=0.01)).rig
    away = np.array([b.matrix[:2, 2] - a.matrix[:2, 2] for a, b in zip(plain.cameras, moved.cameras, strict=True)])
    assert np.sqrt(np.square(away).mean()) == pytest.approx(0.01 * plain.cameras[0].size_px[0], rel=0.4)
    for a, b in zip(plain.cameras, moved.cameras, strict=True):
        np.testing.assert_array_equal(a.camera_from_world, b.camera_from_world)
