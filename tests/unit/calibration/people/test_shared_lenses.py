"""Unknown lenses of cameras of one kind are estimated together, those of different cameras are not."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from benchmarks.calibration_scores import score_calibration

from posefuse.calibration.joint.estimate import JointEstimate, estimate
from posefuse.calibration.joint.parameters import JointParameters
from posefuse.calibration.joint.prior import Prior
from posefuse.calibration.people import estimate as module
from posefuse.calibration.people.estimate import estimate_people
from posefuse.calibration.people.joint_recording import joint_recording
from posefuse.calibration.people.shared_lenses import SPREADS, distortion_prior, mixed, spread_probabilities
from posefuse.kernels.calibration.joint import FOCAL, RADIAL
from tests.unit.calibration.people.matched_scenes import disturbed, walking_person


def relative(found) -> np.ndarray:
    return np.array([camera.matrix[0, 0] / max(camera.size_px) for camera in found.cameras])


def test_similar_cameras_share_their_focal_length(monkeypatch):
    matched, rig = walking_person(duration_s=6.0, seed=1)
    start = disturbed(matched, 4, focal=0.1)
    found = estimate_people(start)
    monkeypatch.setattr(module, "spread_probabilities", lambda *_: np.array([1.0, 0.0, 0.0]))
    alone = estimate_people(start)
    assert score_calibration(found.cameras, rig).worst_focal < score_calibration(alone.cameras, rig).worst_focal
    assert np.ptp(np.log(relative(found))) < 0.8 * np.ptp(np.log(relative(alone)))
    # Different cameras remain probable; for them, the shared estimate is no better.
    variances = [np.trace(each.covariance[:, 8, :, 8]) for each in (found, alone)]
    assert variances[0] >= variances[1]


@pytest.mark.parametrize(("spread", "likely"), [(0.0, 2), (0.06, 1), (0.2, 0)])
def test_measured_focal_lengths_show_how_different_cameras_are(spread, likely):
    joint, log_focal = measured(sd=0.005, log_focal=spread * np.array([1.0, -1.0, 1.0, -1.0]))
    probability = spread_probabilities(joint, log_focal)
    assert probability.sum() == pytest.approx(1.0)
    assert np.argmax(probability) == likely
    assert probability[likely] > 0.6


def test_uncertain_focal_lengths_leave_the_probability_open():
    """Equal values that are known to 14 % say little: several spreads remain probable."""
    joint, log_focal = measured(sd=0.14, log_focal=np.zeros(4))
    probability = spread_probabilities(joint, log_focal)
    assert probability.min() > 0.1


def test_many_uncertain_cameras_that_differ_do_not_count_as_one_kind():
    """Nine focal lengths that differ by 7 % and are known to 7 % are no evidence of cameras of one kind."""
    different = 0.07 * np.random.default_rng(2).standard_normal(9)
    joint, log_focal = measured(sd=0.063, log_focal=different)
    probability = spread_probabilities(joint, log_focal)
    assert probability[SPREADS.index(0.015)] < 0.4


def test_likelihood_of_a_spread_is_that_of_normal_numbers():
    """Estimates whose posterior is known have the evidence of a normal distribution with both variances."""
    sd, differences = 0.05, np.array([0.03, -0.03])
    told = 1.0 / (sd**-2.0 + SPREADS[0] ** -2.0)
    joint, log_focal = measured(np.sqrt(told), told / sd**2 * differences)
    spread = np.array(SPREADS)
    expected = np.exp(-0.5 * 2 * 0.03**2 / (sd**2 + spread**2)) / np.hypot(sd, spread)
    np.testing.assert_allclose(spread_probabilities(joint, log_focal), expected / expected.sum(), rtol=1e-9)


def test_common_distortion_is_as_probable_as_that_of_one_camera():
    """Eight equal coefficients cost little more than a single one; a single different one costs more."""
    prior = distortion_prior(Prior.of_sds(np.ones((8, 10))), np.ones(8, dtype=bool))
    own = np.ix_(*[np.arange(8) * 10 + RADIAL] * 2)
    precision = prior.precision[own]
    equal = np.full(8, 0.28)
    single = 0.28**2 / np.linalg.inv(precision)[0, 0]
    assert equal @ precision @ equal == pytest.approx(single, rel=0.25)
    assert precision[0, 0] * 0.28**2 > 3.0 * single


def measured(sd: float, log_focal: np.ndarray):
    """Return an estimate with independent focal lengths, and what is known of the lenses."""
    n = len(log_focal)
    still = np.zeros(n)
    parameters = JointParameters(np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), still, still, log_focal, still)
    covariance = np.zeros((n, 10, n, 10))
    covariance[np.arange(n), FOCAL, np.arange(n), FOCAL] = sd**2
    joint = SimpleNamespace(parameters=parameters, covariance=covariance.reshape(n * 10, n * 10))
    return cast("JointEstimate", joint), still


@pytest.mark.parametrize("widest", [0, 1])
def test_mixture_is_as_uncertain_as_the_widest_spread_that_is_probable(widest):
    """The covariance is that of the widest spread with any probability, and covers its distance from the mean."""
    recording, _ = joint_recording(walking_person(duration_s=1.0)[0])
    first = estimate(recording)
    assert first is not None
    change = np.zeros_like(first.change)
    change[1, 3] = 0.2
    moved = first.parameters.changed(change)
    estimates = [
        replace(first, parameters=parameters, covariance=factor * first.covariance)
        for factor, parameters in ((4.0, first.parameters), (2.0, first.parameters), (1.0, moved))
    ]
    probability = np.array([[0.25, 0.0, 0.75], [0.0, 0.25, 0.75]][widest])
    both = mixed(estimates, probability, recording)
    apart = first.projection @ change.ravel()
    added = both.covariance - estimates[widest].covariance
    np.testing.assert_allclose(added, 0.75**2 * np.outer(apart, apart), atol=1e-12)
    shift = both.parameters.center_m - first.parameters.center_m
    np.testing.assert_allclose(shift, 0.75 * change[:, 3:6], atol=1e-12)


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
