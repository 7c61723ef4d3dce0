"""Simulated walking people."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from posefuse.model.status import PointStatus
from posefuse.synthetic.crowd_options import NO_FAULTS, SCENARIOS, CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from posefuse.synthetic.options import CLEAN
from tests.unit.synthetic.test_crowds import during, gaps_of, points_of

EXACT = replace(CLEAN, sigma_px=0.0)
SOME = {"crowd": 12.0, "ten": 5.0}


@pytest.fixture(scope="module", params=SCENARIOS)
def any_scene(request):
    return simulate_crowd(CrowdOptions(request.param, duration_s=SOME.get(request.param), seed=1))


@pytest.fixture(scope="module")
def crowd():
    return simulate_crowd(CrowdOptions(duration_s=30.0))


class TestTruth:
    def test_bones_keep_their_length(self, any_scene):
        points, skeleton = points_of(any_scene), any_scene.truth.skeleton
        for limb in ("arm", "leg"):
            for inner, outer in pairwise(skeleton.chains[limb]):
                for upper, lower in zip(inner, outer, strict=True):
                    bone = points[:, :, skeleton.index(upper)] - points[:, :, skeleton.index(lower)]
                    assert (
                        np.ptp(np.linalg.norm(bone[np.isfinite(bone).all(axis=(1, 2))], axis=-1), axis=0).max() < 1e-9
                    )

    def test_people_are_present_only_in_their_spans(self, any_scene):
        points = points_of(any_scene)
        present = np.isfinite(points).all(axis=(2, 3))
        for p in range(points.shape[1]):
            messages = [during(any_scene, s) for s in any_scene.spans if s.what == "present" and s.person == p]
            np.testing.assert_array_equal(present[:, p], np.any(messages, axis=0))
        status = any_scene.truth.layers["measured"].status
        assert (status[~present] == PointStatus.NOT_SEEN).all()
        assert (status[present] == PointStatus.OK).all()
        assert any_scene.truth.person_ids == tuple(f"person_{p + 1}" for p in range(points.shape[1]))

    def test_people_do_not_walk_through_each_other(self, any_scene):
        hugging = any(span.what == "hug" for span in any_scene.spans)
        assert gaps_of(any_scene).min() > (0.2 if hugging else 0.35)

    def test_people_walk_on_the_floor_at_walking_speed(self, any_scene):
        points, rate_hz = points_of(any_scene), any_scene.detections.rate_hz
        hips = points[:, :, any_scene.truth.skeleton.index("mid_hip")]
        pace = np.linalg.norm(np.diff(hips, axis=0), axis=-1) * rate_hz
        assert np.nanmax(pace) < 2.2
        assert 0.02 < np.nanmin(points[..., 2]) < 0.25
        ankles = points[:, :, any_scene.truth.skeleton.index("left_ankle")]
        assert np.nanmax(np.linalg.norm(np.diff(ankles, axis=0), axis=-1)) * rate_hz < 6.0

    def test_paths_cross(self, crowd):
        middle = points_of(crowd)[:, :2, crowd.truth.skeleton.index("mid_hip"), :2]
        bearing = np.unwrap(np.arctan2(*(middle[:, 0] - middle[:, 1]).T[::-1]))
        assert (gaps_of(crowd) < 1.0).mean() > 0.1
        assert np.ptp(bearing) > np.pi

    def test_walk_is_independent_of_the_frame_rate(self):
        slow, fast = (simulate_crowd(CrowdOptions("crowd", duration_s=8.0, rate_hz=hz)) for hz in (25.0, 100.0))
        np.testing.assert_allclose(points_of(slow), points_of(fast)[::4], atol=1e-9)

    def test_statures(self):
        options = CrowdOptions("hug", statures_m=(1.5, 1.8), detector=EXACT, faults=NO_FAULTS)
        scene = simulate_crowd(options)
        skeleton = scene.truth.skeleton
        thigh = [skeleton.index("left_hip"), skeleton.index("left_knee")]
        lengths = np.linalg.norm(np.subtract(*(points_of(scene)[0, :, k] for k in thigh)), axis=-1)
        np.testing.assert_allclose(lengths, 0.43 * np.array([1.5, 1.8]) / 1.75)
