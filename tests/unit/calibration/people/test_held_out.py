"""Held-out errors show the noise of the detections and wrong cameras."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.joint.estimate import estimate
from posefuse.calibration.joint.prior import Prior
from posefuse.calibration.people.held_out import held_out_errors
from posefuse.calibration.people.joint_recording import joint_recording
from tests.unit.calibration.people.matched_scenes import walking_person

NARROW = np.array([1e-4] * 6 + [1e-3, 1e-5])
"""A prior that leaves the cameras as they are."""


def test_wrong_camera_has_larger_errors():
    matched, rig = walking_person(duration_s=4.0)
    recording, _ = joint_recording(matched)
    prior = Prior.of_sds(np.tile(NARROW, (4, 1)))
    right = estimate(recording, prior=prior)
    assert right is not None
    errors = held_out_errors(recording, right, prior)
    assert rig.cameras[0].matrix[0, 0] * np.median(errors) == pytest.approx(22.0, abs=7.0)
    center = recording.center_m.copy()
    center[1] += 0.5
    moved = replace(recording, center_m=center)
    wrong = estimate(moved, prior=prior)
    assert wrong is not None
    assert held_out_errors(moved, wrong, prior)[1] > 2.0 * errors[1]


def test_two_views_have_no_held_out_error():
    recording, _ = joint_recording(walking_person(cameras=2, duration_s=4.0)[0])
    prior = Prior.of_sds(np.tile(NARROW, (2, 1)))
    joint = estimate(recording, prior=prior)
    assert joint is not None
    assert np.isnan(held_out_errors(recording, joint, prior)).all()
