"""The noise of a recording, as the pipeline finds it."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.walking import walk

from posefuse.errors import DetectionsError, OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.noise import NoiseOptions
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import unpack_covariance
from posefuse.model.status import ViewStatus
from posefuse.pipeline.calibrate_noise import calibrate_noise
from posefuse.pipeline.reconstruct import reconstruct
from tests.scenes import body_points, build_rig, ring, simulate_detections, skeleton_of


@pytest.mark.parametrize("sigma", [0.5, 2.0, 8.0])
@pytest.mark.parametrize("lens", ["pinhole", "barrel"])
def test_noise_is_estimated_from_residuals(sigma, lens, rng):
    rig = ring(4, lens)
    result = reconstruct(rig, simulate_detections(rig, body_points(rng, 300), rng, sigma))
    assert result.noise.origin == "estimated"
    np.testing.assert_allclose(result.noise.scale_px, sigma, rtol=0.04)


def test_noise_is_estimated_with_a_confidence_exponent(rng):
    rig = ring(4)
    truth = body_points(rng, 300)
    confidence = rng.uniform(0.3, 1.0, (300, 4, 17))
    pixels = rig.project(truth)
    pixels = pixels + (3.0 / confidence)[..., None] * rng.standard_normal(pixels.shape)
    detections = Detections.from_dense(skeleton_of(17), rig.names, pixels, confidence)
    options = Options(triangulation=TriangulationOptions(confidence_exponent=1.0))
    result = reconstruct(rig, detections, options)
    np.testing.assert_allclose(result.noise.scale_px, 3.0, rtol=0.04)


@pytest.mark.parametrize(("views", "share", "most"), [(5, 0.05, 1.15), (8, 0.05, 1.15), (12, 0.1, 1.35)])
def test_outliers_change_the_estimate_little_with_any_number_of_views(views, share, most, rng):
    rig = ring(views)
    truth = body_points(rng, 300)
    pixels = rig.project(truth) + 2.0 * rng.standard_normal((300, views, 17, 2))
    wrong = rng.random(pixels.shape[:-1]) < share
    angle = rng.uniform(0, 2 * np.pi, pixels.shape[:-1])
    away = (wrong * rng.uniform(30, 300, wrong.shape))[..., None]
    pixels += away * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    result = reconstruct(rig, Detections.from_dense(skeleton_of(17), rig.names, pixels))
    assert 0.96 < result.noise.scale_px[0] / 2.0 < most


@pytest.mark.filterwarnings("ignore:The views do not agree")
@pytest.mark.parametrize(("views", "share"), [(8, 0.4), (16, 0.4)])
def test_many_outliers_change_the_estimate_little(views, share):
    data = walk(60, views, outlier_share=share)
    result = reconstruct(data.rig, data.detections)
    np.testing.assert_allclose(result.noise.scale_px, 2.0, rtol=0.05)


def test_cameras_have_different_scales_where_noise_differs(rng):
    data = walk(200)
    noisier = np.array([1.0, 1.0, 2.5, 1.0, 1.5])
    pixels = data.rig.project(data.points_m)
    pixels = pixels + 2.0 * noisier[:, None, None] * rng.standard_normal(pixels.shape)
    result = reconstruct(data.rig, replace(data, pixels=pixels).detections)
    np.testing.assert_allclose(result.noise.scale_px, 2.0 * noisier, rtol=0.25)


@pytest.mark.filterwarnings("ignore::posefuse.errors.PosefuseWarning")
def test_constant_error_of_a_camera_is_added_to_its_noise(rng):
    """Noise of 2 px and an offset of (6, 4) px, which counts ten times because it lasts, make 16 px per axis."""
    data = walk(200)
    pixels = data.pixels.copy()
    pixels[:, 2] += [6.0, 4.0]
    result = reconstruct(data.rig, replace(data, pixels=pixels).detections)
    np.testing.assert_allclose(result.noise.scale_px, [2.0, 2.0, 16.2, 2.0, 2.0], rtol=0.08)


@pytest.mark.filterwarnings("ignore::posefuse.errors.PosefuseWarning")
def test_covariances_contain_the_systematic_error_of_a_camera(rng):
    data = walk(200)
    pixels = data.pixels.copy()
    pixels[:, 2] += [6.0, 4.0]
    layer = reconstruct(data.rig, replace(data, pixels=pixels).detections).layers["measured"]
    offset = layer.points_m[:, 0] - data.points_m
    inverse = np.linalg.inv(unpack_covariance(layer.covariance_m2[:, 0]))
    inside = np.einsum("fki,fkij,fkj->fk", offset, inverse, offset) < 7.8147
    assert 0.93 < inside.mean() < 0.99


def test_confidence_regions_have_the_stated_coverage_under_heavy_tails(rng):
    data = walk(300)
    pixels = data.rig.project(data.points_m)
    pixels = pixels + 2.0 * rng.standard_t(3.0, pixels.shape)
    result = reconstruct(data.rig, replace(data, pixels=pixels).detections)
    assert result.noise.spread > 1.05
    layer = result.layers["measured"]
    offset = layer.points_m[:, 0] - data.points_m
    inverse = np.linalg.inv(unpack_covariance(layer.covariance_m2[:, 0]))
    inside = np.einsum("fki,fkij,fkj->fk", offset, inverse, offset) < 7.8147
    assert 0.90 < inside.mean() < 0.97


def test_point_beyond_the_fold_of_a_lens_is_tolerated(rng):
    rig = build_rig("ring", 4, "barrel")
    pixels = rig.project(body_points(rng, 60)) + rng.standard_normal((60, 4, 17, 2))
    pixels[7, :, 3] = [[1825.77, 639.55], [111.71, 688.24], [643.61, 464.68], [1437.14, 416.14]]
    result = reconstruct(rig, Detections.from_dense(skeleton_of(17), rig.names, pixels))
    layer = result.layers["measured"]
    used = layer.view_status == ViewStatus.USED
    assert np.isfinite(layer.view_error_px[used & layer.has_point[..., None]]).all()
    np.testing.assert_allclose(result.noise.scale_px, 1.0, rtol=0.06)


def test_noise_fixed_by_the_user(rng):
    rig = ring(4)
    result = reconstruct(rig, simulate_detections(rig, body_points(rng, 5), rng), Options(noise_scale_px=7.0))
    assert result.noise.origin == "fixed"
    assert (result.noise.scale_px == 7.0).all()


def test_noise_is_assumed_with_too_few_points(rng):
    rig = ring(4)
    result = reconstruct(rig, simulate_detections(rig, body_points(rng, 1), rng))
    assert result.noise.origin == "assumed"
    np.testing.assert_allclose(result.noise.scale_px, 4.5 * 1.92)


@pytest.mark.parametrize(("exponent", "nu"), [(0.0, 100.0), (1.0, 3.0), (0.5, 6.0)])
def test_error_model_is_calibrated_by_leaving_views_out(exponent, nu, rng):
    rig = ring(5)
    truth = body_points(rng, 300)
    confidence = rng.uniform(0.3, 1.0, (300, 5, 17))
    error = rng.standard_normal((300, 5, 17, 2)) / np.sqrt(rng.chisquare(nu, confidence.shape) / nu)[..., None]
    pixels = rig.project(truth) + (3.0 / confidence**exponent)[..., None] * error
    noise = calibrate_noise(rig, Detections.from_dense(skeleton_of(17), rig.names, pixels, confidence))
    assert noise.origin == "calibrated"
    assert noise.exponent == pytest.approx(exponent, abs=0.1)
    assert 1.0 / noise.nu == pytest.approx(1.0 / nu, abs=0.05)
    assert 3.0 * 0.95 < noise.scale_px[0] < 3.0 * 1.25


def test_calibration_with_too_few_points_is_an_error(rng):
    rig = ring(4)
    with pytest.raises(DetectionsError, match="seen by three agreeing views"):
        calibrate_noise(rig, simulate_detections(rig, body_points(rng, 1), rng))


def test_calibrated_noise_is_used_by_camera_name(rng):
    rig = ring(4)
    detections = simulate_detections(rig, body_points(rng, 20), rng)
    noise = NoiseOptions(("cam_3", "cam_1", "cam_0", "cam_2", "spare"), (4.0, 2.0, 1.0, 3.0, 9.0), 1.5, 3.0)
    result = reconstruct(rig, detections, Options(noise=noise)).noise
    assert result.scale_px.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert (result.origin, result.spread, result.nu) == ("calibrated", 1.5, 3.0)
    with pytest.raises(OptionsError, match="no scale for cam_3"):
        reconstruct(rig, detections, Options(noise=NoiseOptions(("cam_0", "cam_1", "cam_2"), (1.0, 1.0, 1.0))))
    with pytest.raises(OptionsError, match=r"one number per camera in noise\.cameras \(2\), got 1"):
        NoiseOptions(("cam_0", "cam_1"), (1.0,))


def _turned(rig, view, degrees):
    """Return the rig with one camera rotated about its own vertical axis."""
    angle = np.radians(degrees)
    turn = np.eye(4)
    turn[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)
    cameras = list(rig.cameras)
    cameras[view] = replace(cameras[view], camera_from_world=turn @ cameras[view].camera_from_world)
    return CameraRig(tuple(cameras))


def _mean_error_m(rig, detections, truth_m):
    points = reconstruct(rig, detections, Options(health="off")).layers["measured"].points_m[:, 0]
    return np.nanmean(np.linalg.norm(points - truth_m, axis=-1))


@pytest.mark.filterwarnings("ignore::posefuse.errors.PosefuseWarning")
@pytest.mark.parametrize("degrees", [0.5, 1.0])
def test_points_are_as_accurate_with_a_misplaced_camera_as_without_it(degrees):
    data = walk(100, 4)
    others = tuple(name for i, name in enumerate(data.rig.names) if i != 2)
    alone = _mean_error_m(data.rig.select(others), data.detections.views(others), data.points_m)
    assert _mean_error_m(_turned(data.rig, 2, degrees), data.detections, data.points_m) < 1.05 * alone


def test_cameras_that_are_well_placed_have_equal_noise():
    data = walk(100, 4)
    assert np.ptp(reconstruct(data.rig, data.detections).noise.scale_px) == 0.0
