"""Invariances of triangulation: order of cameras, origin and scale of the world, and neighboring frames."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Layer, unpack_covariance
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.pipeline.reconstruct import reconstruct
from tests.properties import examples
from tests.scenes import LENSES, body_points, ring, simulate_detections, skeleton_of

seeds = st.integers(0, 2**32 - 1)
lenses = st.sampled_from(sorted(LENSES))
# Convergence stops at a thousandth of the standard error of a point, which is about 7 mm here.
CLOSE_M = 2e-5


def measured(rig: CameraRig, detections: Detections) -> Layer:
    """Return the measured layer for a fixed noise scale, so that only geometry matters."""
    return reconstruct(rig, detections, Options(noise_scale_px=2.0)).layers["measured"]


def scene(seed: int, lens: str, cameras: int = 5) -> tuple[CameraRig, Detections]:
    """Return ten frames with a fifth of the keypoints missing."""
    rng = np.random.default_rng(seed)
    rig = ring(cameras, lens)
    detections = simulate_detections(rig, body_points(rng, 10), rng)
    keypoints = np.array(detections.keypoints_px)
    keypoints[rng.random(keypoints.shape[:-1]) < 0.2] = np.nan
    return rig, replace(detections, keypoints_px=keypoints)


@given(seed=seeds, lens=lenses)
@examples(15)
def test_result_is_independent_of_the_camera_order(seed, lens):
    rig, detections = scene(seed, lens)
    order = np.random.default_rng(seed).permutation(5)
    names = [rig.names[i] for i in order]
    one, other = measured(rig, detections), measured(rig.select(names), detections.views(names))
    np.testing.assert_array_equal(one.status, other.status)
    np.testing.assert_allclose(one.points_m, other.points_m, atol=CLOSE_M)
    np.testing.assert_array_equal(one.view_status[..., order], other.view_status)


@given(seed=seeds, lens=lenses, shift=st.tuples(*[st.floats(-50, 50)] * 3))
@examples(15)
def test_result_follows_a_change_of_world_coordinates(seed, lens, shift):
    rig, detections = scene(seed, lens)
    new_from_old = np.eye(4)
    new_from_old[:3, :3] = Rotation.random(random_state=seed % 2**31).as_matrix()
    new_from_old[:3, 3] = shift
    old_from_new = np.linalg.inv(new_from_old)
    moved = CameraRig(tuple(replace(c, camera_from_world=c.camera_from_world @ old_from_new) for c in rig.cameras))
    one, other = measured(rig, detections), measured(moved, detections)
    np.testing.assert_array_equal(one.status, other.status)
    expected = one.points_m @ new_from_old[:3, :3].T + new_from_old[:3, 3]
    np.testing.assert_allclose(other.points_m, expected, atol=CLOSE_M)
    turn = new_from_old[:3, :3]
    covariance = turn @ unpack_covariance(one.covariance_m2) @ turn.T
    np.testing.assert_allclose(unpack_covariance(other.covariance_m2), covariance, rtol=0.01, atol=1e-8)


@pytest.mark.filterwarnings("ignore:The scale is wrong:posefuse.errors.PosefuseWarning")
@given(seed=seeds, lens=lenses, factor=st.floats(0.001, 1000))
@examples(15)
def test_result_scales_with_the_world(seed, lens, factor):
    rig, detections = scene(seed, lens)

    def scaled(camera: Camera) -> Camera:
        pose = np.array(camera.camera_from_world)
        pose[:3, 3] *= factor
        return replace(camera, camera_from_world=pose)

    one = measured(rig, detections)
    other = measured(CameraRig(tuple(scaled(camera) for camera in rig.cameras)), detections)
    np.testing.assert_array_equal(one.status, other.status)
    np.testing.assert_allclose(other.points_m / factor, one.points_m, atol=CLOSE_M)
    np.testing.assert_allclose(other.sd_m / factor, one.sd_m, rtol=0.01)


@given(seed=seeds, lens=lenses)
@examples(10)
def test_frames_are_independent(seed, lens):
    rig, detections = scene(seed, lens)
    whole = measured(rig, detections)
    for f in (0, 4, 9):
        assert measured(rig, detections.frames(f, f + 1)) == whole.frames(f, f + 1)


@given(seed=seeds)
@examples(10)
def test_coordinates_agree_with_the_status(seed):
    layer = measured(*scene(seed, "barrel"))
    has_point = layer.status < PointStatus.NOT_SEEN
    for array in (layer.points_m, layer.covariance_m2):
        np.testing.assert_array_equal(np.isfinite(array).all(axis=-1), has_point)
        np.testing.assert_array_equal(np.isnan(array).all(axis=-1), ~has_point)
    used = layer.view_status == ViewStatus.USED
    np.testing.assert_array_equal(used.any(axis=-1), has_point)
    assert (used.sum(axis=-1)[has_point] >= 2).all()
    mean = np.where(used, layer.view_error_px, 0).sum(axis=-1) / np.maximum(used.sum(axis=-1), 1)
    np.testing.assert_allclose(layer.reprojection_error_px[has_point], mean[has_point], rtol=1e-5)


@pytest.mark.parametrize(
    "lens",
    [
        lens if lens in ("pinhole", "rational", "fisheye") else pytest.param(lens, marks=pytest.mark.long)
        for lens in LENSES
    ],
)
def test_covariance_regions_have_nominal_coverage(lens):
    """68 % and 95 % regions, with the noise estimated from the recording."""
    rng = np.random.default_rng(1)
    rig = ring(5, lens)
    truth = body_points(rng, 1200)
    layer = reconstruct(rig, simulate_detections(rig, truth, rng)).layers["measured"]
    offset = layer.points_m[:, 0] - truth
    squared = np.einsum("fki,fkij,fkj->fk", offset, np.linalg.inv(unpack_covariance(layer.covariance_m2[:, 0])), offset)
    assert 0.66 < (squared < 3.5059).mean() < 0.70
    assert 0.94 < (squared < 7.8147).mean() < 0.96


def test_missing_views_only_widen_the_covariance(rng):
    rig = ring(5)
    truth = body_points(rng, 20)
    detections = simulate_detections(rig, truth, rng)
    all_views = measured(rig, detections)
    fewer = measured(rig.select(rig.names[:3]), detections.views(rig.names[:3]))
    assert (fewer.sd_m > all_views.sd_m).all()


@given(seed=seeds, share=st.floats(0, 1))
@examples(20)
@pytest.mark.filterwarnings("ignore:The views do not agree", "ignore:Most of what camera")
def test_any_pattern_of_missing_keypoints_is_accepted(seed, share):
    rng = np.random.default_rng(seed)
    rig = ring(4, "fisheye")
    pixels = rng.uniform(-500, 2500, (6, 4, 17, 2))
    pixels[rng.random(pixels.shape) < share] = np.nan
    confidence = rng.uniform(0, 1, (6, 4, 17))
    confidence[rng.random(confidence.shape) < share] = np.nan
    layer = measured(rig, Detections.from_dense(skeleton_of(17), rig.names, pixels, confidence, rate_hz=30))
    assert not np.isinf(layer.points_m).any()
    np.testing.assert_array_equal(np.isfinite(layer.points_m).all(axis=-1), layer.has_point)
