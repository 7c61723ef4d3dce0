"""Statuses of points: each implies coordinates, a covariance and views, whatever the method and its options."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posefuse.model.cameras import CameraRig
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import (
    METHODS,
    PercentileFilterOptions,
    TriangulationOptions,
    WeightedSubsetsOptions,
)
from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.model.tracks import Tracks
from posefuse.pipeline.reconstruct import triangulate
from posefuse.triangulation.registry import find_method
from tests.scenes import body_points, ring, simulate_detections
from tests.statuses import assert_statuses_hold

# Outliers and weak geometry are what these scenes consist of.
pytestmark = pytest.mark.filterwarnings("ignore::posefuse.errors.PosefuseWarning")


def measured(rig: CameraRig, method: str, n_frames: int = 12, outliers: float = 0.1, seed: int = 0, **options) -> Layer:
    """Return the measured layer of a moving body with outliers."""
    rng = np.random.default_rng(seed)
    detections = simulate_detections(rig, body_points(rng, n_frames), rng)
    pixels = np.array(detections.keypoints_px)
    hit = rng.random(pixels.shape[:2]) < outliers
    pixels[hit] += rng.normal(0.0, 80.0, (hit.sum(), 2))
    pixels[rng.random(pixels.shape[:2]) < 0.05] = np.nan
    chosen = TriangulationOptions(method=method, **options)  # type: ignore[arg-type]
    return triangulate(
        rig, replace(detections, keypoints_px=pixels), Options(pairs="labels", noise_scale_px=2.0, triangulation=chosen)
    ).layers["measured"]


def close_cameras(n: int = 3) -> CameraRig:
    """Return cameras 3 cm apart, 5 m from a person."""
    rig = ring(n)
    cameras = []
    for k, camera in enumerate(rig.cameras):
        pose = rig.cameras[0].camera_from_world.copy()
        pose[0, 3] += 0.03 * k
        cameras.append(replace(camera, camera_from_world=pose))
    return replace(rig, cameras=tuple(cameras))


@pytest.mark.hypothesis
@settings(max_examples=15, deadline=None)
@given(
    method=st.sampled_from(tuple(METHODS)), n_views=st.integers(2, 6), min_views=st.integers(2, 3),
    outliers=st.floats(0.0, 0.5), drops=st.integers(1, 4), seed=st.integers(0, 1000), close=st.booleans(),
)  # fmt: skip
def test_statuses_hold_for_every_method(method, n_views, min_views, outliers, drops, seed, close):
    rig = close_cameras(n_views) if close else ring(n_views)
    subsets = WeightedSubsetsOptions(max_cameras_to_drop=drops)
    layer = measured(
        rig, method, 4, outliers, seed, min_views=min(min_views, n_views), weighted_subsets=subsets,
        percentile_filter=PercentileFilterOptions(percentile=70.0),
    )  # fmt: skip
    assert_statuses_hold(layer)


def test_percentile_filter_gives_no_point_to_opposite_cameras():
    # Two opposite cameras of a ring of four do not determine a point between them.
    rng, rig = np.random.default_rng(3), ring(4)
    cameras = tuple(
        replace(camera, camera_from_world=np.array(pose))
        for camera, pose in zip(rig.cameras, _level_ring(), strict=True)
    )
    rig = replace(rig, cameras=cameras)
    points = np.zeros((20, 17, 3)) + rng.normal(0.0, 1e-6, (20, 17, 3))
    detections = simulate_detections(rig, points, rng, 1e-3)
    pixels = np.array(detections.keypoints_px).reshape(20, 4, 17, 2)
    pixels[::2, 1] += 60.0
    pixels[::2, 3] -= 90.0
    detections = replace(detections, keypoints_px=pixels.reshape(80, 17, 2))
    options = TriangulationOptions(
        method="percentile_filter",
        min_views=2,
        percentile_filter=PercentileFilterOptions(threshold_px=5.0, min_views_left=2),
    )
    layer = triangulate(rig, detections, Options(pairs="labels", noise_scale_px=2.0, triangulation=options)).layers[
        "measured"
    ]
    assert_statuses_hold(layer)
    filtered = layer.status[::2]
    assert not (filtered == PointStatus.TWO_VIEWS).any()
    assert (filtered >= PointStatus.NOT_SEEN).mean() > 0.9


def _level_ring() -> list[np.ndarray]:
    """Return poses of four cameras in a plane with the origin, 5 m away."""
    poses = []
    for angle in (0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi):
        forward = -np.array([np.cos(angle), np.sin(angle), 0.0])
        right = np.cross(forward, [0.0, 0.0, 1.0])
        rotation = np.stack([right, [0.0, 0.0, -1.0], forward])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, rotation @ forward * 5.0
        poses.append(pose)
    return poses


@pytest.mark.parametrize("method", METHODS)
def test_nearly_parallel_rays_are_weak_geometry_for_every_method(method):
    layer = measured(close_cameras(), method, outliers=0.0, min_views=2)
    assert_statuses_hold(layer)
    with_point = layer.status[layer.has_point]
    assert len(with_point) > 50
    assert (with_point >= PointStatus.WEAK_GEOMETRY).mean() > 0.99


@pytest.mark.parametrize("method", METHODS)
def test_recording_without_people_has_a_layer_without_points(method):
    rng, rig = np.random.default_rng(0), ring(4)
    detections = simulate_detections(rig, body_points(rng, 3), rng)
    tracks = Tracks((), np.empty((3, 0, 4), dtype=np.int32), np.empty((3, 0), dtype=np.int8))
    layer = find_method(method).solve(
        rig, detections, tracks, NoiseModel(np.full(4, 2.0)), TriangulationOptions(method=method, min_views=2)
    )
    assert layer.view_status.shape == (3, 0, 17, 4)


@pytest.mark.parametrize("drops", [3, 4, 5])
def test_weighted_subsets_with_many_cameras_to_drop_state_the_views_that_points_rest_on(drops):
    subsets = WeightedSubsetsOptions(max_cameras_to_drop=drops, target_px=0.5)
    layer = measured(ring(8), "weighted_subsets", outliers=0.4, min_views=3, weighted_subsets=subsets)
    assert_statuses_hold(layer)
    assert (layer.view_status[layer.has_point] == ViewStatus.USED).sum(axis=-1).min() >= 3
