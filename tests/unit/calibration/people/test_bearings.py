"""Viewing directions over time."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.people.bearings import bearings_of
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import filmed_person


@pytest.fixture
def people(rng):
    return filmed_person(build_rig("ring", 1, "fisheye"), rng, duration_s=2.0, sigma_px=0.0)


def test_rays_at_frames_are_those_of_the_camera(people):
    view = people.views[0]
    bearings = bearings_of(view, people.skeleton)
    rays, _, sigma = bearings.at(view.time_s[[0, 7, -1]], 0)
    expected, _ = view.camera.rays(view.keypoints_px[[0, 7, -1], 0][:, bearings.keypoints])
    np.testing.assert_allclose(rays, expected, atol=1e-12)
    assert ((sigma > 1e-3) & (sigma < 2e-2)).all()


def test_rays_between_frames_are_interpolated_and_velocities_agree(people):
    view = people.views[0]
    dense = bearings_of(view, people.skeleton)
    thin = bearings_of(
        replace(view, time_s=view.time_s[::2], keypoints_px=view.keypoints_px[::2], confidence=view.confidence[::2]),
        people.skeleton,
    )
    times = view.time_s[11:41:2]
    expected, velocity, _ = dense.at(times, 0)
    found, thin_velocity, _ = thin.at(times, 0)
    assert np.abs(found - expected).max() < 2e-3
    assert np.abs(velocity - thin_velocity).max() < 0.1 * np.abs(velocity).max() + 0.05
    later, _, _ = dense.at(times + 0.01, 0)
    assert np.abs(later - expected - 0.01 * velocity).max() < 2e-3


def test_gaps_and_times_outside_are_missing(people):
    view = people.views[0]
    pixels = view.keypoints_px.copy()
    pixels[20:30] = np.nan
    bearings = bearings_of(replace(view, keypoints_px=pixels), people.skeleton)
    rays, _, _ = bearings.at(np.array([-1.0, view.time_s[25], view.time_s[25] + 0.01, 99.0]), 0)
    assert np.isnan(rays).all()


def test_low_confidence_is_noisier(people):
    view = people.views[0]
    confidence = np.full_like(view.confidence, 0.8)
    confidence[:, :, people.skeleton.index("left_wrist")] = 0.4
    bearings = bearings_of(replace(view, confidence=confidence), people.skeleton)
    wrist = bearings.keypoints.tolist().index(people.skeleton.index("left_wrist"))
    np.testing.assert_allclose(bearings.sigma[:, 0, wrist], 2.0 * bearings.sigma[:, 0, 0])
