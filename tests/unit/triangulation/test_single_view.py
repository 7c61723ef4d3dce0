"""Keypoints of one camera in its image plane."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import DetectionsError
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.model.tracks import Tracks, TrackState
from posefuse.triangulation import single_view
from tests.scenes import body_points, ring, simulate_detections

NOISE = NoiseModel(np.array([4.0]), 1.0)


@pytest.fixture
def one_view(rng):
    """Return detections of one person in one view, and the track that holds them."""
    detections = simulate_detections(ring(1), body_points(rng, 5), rng)
    state = np.full((5, 1), TrackState.ACTIVE, dtype=np.int8)
    return detections, Tracks(("person_1",), np.zeros((5, 1, 1), dtype=np.int32), state)


def test_points_are_the_pixels_with_the_noise_of_the_detections(one_view):
    detections, tracks = one_view
    layer = single_view.solve(detections, tracks, NOISE, TriangulationOptions())
    np.testing.assert_array_equal(layer.points_m[:, 0, :, :2], np.asarray(detections.keypoints_px))
    assert not np.asarray(layer.points_m)[..., 2].any()
    sd_px = np.sqrt(np.asarray(layer.covariance_m2)[:, 0, :, 0])
    np.testing.assert_allclose(sd_px, 4.0 / np.asarray(detections.confidence))
    assert (np.asarray(layer.status) == PointStatus.SINGLE_VIEW).all()


def test_low_confidence_keypoints_are_not_used(one_view):
    detections, tracks = one_view
    confidence = np.array(detections.confidence)
    confidence[2, 3] = 0.1
    options = TriangulationOptions(min_confidence=0.3)
    layer = single_view.solve(replace(detections, confidence=confidence), tracks, NOISE, options)
    assert np.isnan(layer.points_m[2, 0, 3]).all()
    assert layer.view_status[2, 0, 3, 0] == ViewStatus.LOW_CONFIDENCE
    assert np.isfinite(layer.points_m).all(axis=-1).sum() == layer.points_m[..., 0].size - 1


def test_depth_has_a_variance(one_view, rng):
    detections, tracks = one_view
    depth = rng.normal(0.0, 30.0, np.shape(detections.confidence))
    options = TriangulationOptions(flatten_single_view=False)
    layer = single_view.solve(replace(detections, depth=depth), tracks, NOISE, options)
    covariance = np.asarray(layer.covariance_m2)[:, 0]
    spread = np.var(depth, axis=1)[:, None]
    np.testing.assert_allclose(covariance[..., 5], covariance[..., 0] + spread)


def test_depth_is_required_if_points_are_not_flattened(one_view):
    with pytest.raises(DetectionsError, match="these keypoints have none"):
        single_view.solve(*one_view, NOISE, TriangulationOptions(flatten_single_view=False))
