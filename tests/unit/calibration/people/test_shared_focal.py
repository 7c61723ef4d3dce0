"""Unknown focal lengths of cameras of one kind are estimated together, those of different cameras are not."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from benchmarks.calibration_scores import score_calibration

from posefuse.calibration.joint.estimate import JointEstimate, estimate
from posefuse.calibration.joint.parameters import JointParameters
from posefuse.calibration.people import estimate as module
from posefuse.calibration.people.estimate import estimate_people
from posefuse.calibration.people.joint_recording import joint_recording
from posefuse.calibration.people.shared_focal import mixed, probability_of_one_kind
from posefuse.kernels.calibration.joint import FOCAL
from tests.unit.calibration.people.matched_scenes import disturbed, walking_person


def relative(found) -> np.ndarray:
    return np.array([camera.matrix[0, 0] / max(camera.size_px) for camera in found.cameras])


def test_similar_cameras_share_their_focal_length(monkeypatch):
    matched, rig = walking_person(duration_s=6.0, seed=1)
    start = disturbed(matched, 4, focal=0.1)
    found = estimate_people(start)
    monkeypatch.setattr(module, "probability_of_one_kind", lambda *_: 0.0)
    alone = estimate_people(start)
    assert score_calibration(found.cameras, rig).worst_focal < score_calibration(alone.cameras, rig).worst_focal
    assert np.ptp(np.log(relative(found))) < 0.8 * np.ptp(np.log(relative(alone)))
    variances = [np.trace(each.covariance[:, 8, :, 8]) for each in (found, alone)]
    assert variances[0] < variances[1]


@pytest.mark.parametrize(("spread", "least", "most"), [(0.0, 0.5, 1.0), (0.15, 0.0, 0.02)])
def test_measured_focal_lengths_show_whether_cameras_are_of_one_kind(spread, least, most):
    joint, log_focal = measured(sd=0.01, log_focal=spread * np.array([1.0, -1.0, 1.0, -1.0]))
    assert least <= probability_of_one_kind(joint, log_focal) <= most


def test_uncertain_focal_lengths_leave_the_probability_open():
    """Equal values that are known to 15 % say nothing: the result is the mean of both estimates."""
    joint, log_focal = measured(sd=0.15, log_focal=np.zeros(4))
    probability = probability_of_one_kind(joint, log_focal)
    assert 0.3 < probability < 0.9


def measured(sd: float, log_focal: np.ndarray):
    """Return an estimate with independent focal lengths, and what is known of the lenses."""
    n = len(log_focal)
    still = np.zeros(n)
    parameters = JointParameters(np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), still, still, log_focal, still)
    covariance = np.zeros((n, 10, n, 10))
    covariance[np.arange(n), FOCAL, np.arange(n), FOCAL] = sd**2
    joint = SimpleNamespace(parameters=parameters, covariance=covariance.reshape(n * 10, n * 10))
    return cast("JointEstimate", joint), still


def test_mixture_covers_both_estimates():
    """The covariance of a mixture of two equally likely values +-a with variance s is s + a^2."""
    recording, _ = joint_recording(walking_person(duration_s=1.0)[0])
    first = estimate(recording)
    assert first is not None
    change = np.zeros_like(first.change)
    change[1, 3] = 0.2
    second = replace(first, parameters=first.parameters.changed(change))
    both = mixed(first, second, 0.5, recording)
    apart = first.projection @ change.ravel()
    np.testing.assert_allclose(both.covariance - first.covariance, 0.25 * np.outer(apart, apart), atol=1e-12)
    np.testing.assert_allclose(both.parameters.center_m - first.parameters.center_m, 0.5 * change[:, 3:6], atol=1e-12)


def test_another_lens_is_recognized():
    matched, _ = walking_person(duration_s=6.0, seed=1)
    zoomed = matched.views[1]
    matrix = np.array(zoomed.camera.matrix)
    center = matrix[:2, 2].copy()
    matrix[:2, :2] *= 1.6
    pixels = center + 1.6 * (zoomed.keypoints_px - center)
    other = replace(zoomed, camera=replace(zoomed.camera, matrix=matrix), keypoints_px=pixels)
    views = (matched.views[0], other, *matched.views[2:])
    found = relative(estimate_people(disturbed(replace(matched, views=views), 4, focal=0.05)))
    assert found[1] / np.median(found) == pytest.approx(1.6, rel=0.15)


def test_known_focal_lengths_are_unaffected():
    matched, rig = walking_person(duration_s=2.0)
    assert score_calibration(estimate_people(matched).cameras, rig).worst_focal == 0.0
