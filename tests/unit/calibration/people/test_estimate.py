"""A calibration from people recovers poses, clocks and focal lengths from a disturbed start."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.calibration_scores import score_calibration
from benchmarks.people_calibration import true_start
from benchmarks.simulated_rigs import random_options, simulate_rig

from posefuse.calibration.people.estimate import estimate_people
from posefuse.errors import CalibrationError
from tests.unit.calibration.people.matched_scenes import disturbed, walking_person


def test_poses_and_clocks_are_recovered():
    """Cameras of 25 and 30 Hz that start up to 1.8 s apart, from poses that are 5 degrees and 0.4 m wrong."""
    matched, rig = walking_person(rates_hz=(25.0, 30.0), offsets_s=(0.0, 0.7, -1.1, 0.3))
    found = estimate_people(disturbed(matched, 1, offset_s=0.1))
    score = score_calibration(
        found.cameras, rig, offset_s=found.offset_s, true_offset_s=matched.offset_s, rate_hz=np.resize([25.0, 30.0], 4)
    )
    assert score.worst_rotation_deg < 3.0
    assert score.worst_center_m < 0.3
    assert score.worst_offset_frames < 0.5
    assert score.focal == 0.0
    apart = found.offset_s - matched.offset_s
    assert (np.abs(apart - apart[0])[1:] < 4.0 * found.offset_sd_s[1:]).all()
    assert found.offset_sd_s[0] == 0.0
    assert np.nanmax(found.held_out_px) < 30.0


def test_world_and_scale_are_those_of_the_start():
    matched, _ = walking_person(duration_s=4.0)
    small = [replace(view, camera=_scaled(view.camera, 0.5)) for view in matched.views]
    lengths = [estimate_people(m).bones_m for m in (matched, replace(matched, views=tuple(small)))]
    knee = (0, "left_hip", "left_knee")
    assert lengths[1][knee] == pytest.approx(0.5 * lengths[0][knee], rel=0.02)
    assert lengths[0][knee] == lengths[0][0, "right_hip", "right_knee"]


def _scaled(camera, factor):
    pose = np.array(camera.camera_from_world)
    pose[:3, 3] *= factor
    return replace(camera, camera_from_world=pose)


def test_unknown_focal_lengths_are_recovered():
    matched, rig = walking_person(duration_s=8.0)
    found = estimate_people(disturbed(matched, 2, focal=0.1))
    score = score_calibration(found.cameras, rig)
    assert score.worst_focal < 0.06
    assert score.rotation_deg < 1.5
    assert (np.sqrt(np.diagonal(found.covariance[:, 8, :, 8])) > 1e-3).all()


def test_unknown_distortion_does_not_bias_the_focal_length():
    """Along an aisle, a lens with k1 = -0.28 that counts as a pinhole makes the focal length 9 % wrong."""
    case = simulate_rig(random_options(8))
    found = estimate_people(true_start(case, np.random.default_rng(8), focal_known=False))
    score = score_calibration(found.cameras, case.rig)
    assert score.focal < 0.03
    assert np.median([camera.distortion[0] for camera in found.cameras]) < -0.1


def test_same_input_gives_the_same_bytes():
    matched = disturbed(walking_person(duration_s=2.0)[0], 3)
    first, second = estimate_people(matched), estimate_people(matched)
    assert first.covariance.tobytes() == second.covariance.tobytes()
    assert first.cameras == second.cameras


def test_two_cameras_that_do_not_determine_their_focal_lengths_are_refused():
    matched = disturbed(walking_person(cameras=2, duration_s=3.0)[0], 2, focal=0.1)
    with pytest.raises(CalibrationError, match="do not determine the focal lengths.*Give the lenses"):
        estimate_people(matched)


def test_views_without_shared_people_are_refused():
    matched, _ = walking_person(cameras=2, duration_s=2.0)
    apart = replace(matched, offset_s=np.array([0.0, 100.0]))
    with pytest.raises(CalibrationError, match="No two views observe the same person"):
        estimate_people(apart)
