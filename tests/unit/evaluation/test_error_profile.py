"""Errors before and after a filter, along every axis."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.evaluation.error_profile import error_profile
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.status import ViewStatus
from posefuse.pipeline.reconstruct import reconstruct
from tests.scenes import body_points, ring, simulate_detections


@pytest.fixture(scope="module")
def result():
    rng = np.random.default_rng(5)
    rig = ring(4)
    simply = Options(noise_scale_px=2.0, triangulation=TriangulationOptions(method="simple"))
    detections = simulate_detections(rig, body_points(rng, 30, 6), rng)
    keypoints = np.array(detections.keypoints_px)
    keypoints[:10, 2] = np.nan
    return reconstruct(rig, replace(detections, keypoints_px=keypoints), simply)


def test_every_axis_equals_a_naive_loop(result):
    layer = result.layers["measured"]
    errors = np.where(layer.view_status == ViewStatus.USED, layer.view_error_px, np.nan)[:, 0]
    actual = error_profile([result])
    for f in range(30):
        assert actual.frame_mean_px[f] == pytest.approx(np.nanmean(errors[f]))
    for v in range(4):
        assert actual.view_mean_px[v] == pytest.approx(np.nanmean(errors[..., v]))
        assert actual.view_p95_px[v] == pytest.approx(np.nanpercentile(errors[..., v], 95))
    for k in range(6):
        assert actual.keypoint_mean_px[k] == pytest.approx(np.nanmean(errors[:, k]))
        assert actual.keypoint_p95_px[k] == pytest.approx(np.nanpercentile(errors[:, k], 95))
    assert actual.missing_share == pytest.approx(np.isnan(layer.points_m).any(axis=-1).mean())


def test_result_is_independent_of_frame_ranges(result):
    whole, parts = error_profile([result]), error_profile(result.chunks(7))
    for name in ("frame_numbers", "frame_mean_px", "view_p95_px", "keypoint_mean_px"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name))


def test_empty_input_gives_nan_without_warnings(result):
    layer = result.layers["measured"]
    layer.view_status[:, :, 5] = ViewStatus.UNSEEN
    actual = error_profile([result])
    assert np.isnan([actual.keypoint_mean_px[5], actual.keypoint_p95_px[5]]).all()
