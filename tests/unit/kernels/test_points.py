"""Triangulation kernels against maximum likelihood by SciPy, and their statuses."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.arrays import kernel_array
from posefuse.kernels import status_codes
from posefuse.kernels.cameras import points
from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.linear_algebra import symmetric_3x3
from posefuse.kernels.records import NoiseParameters, Observations, TriangulatedPoints
from posefuse.kernels.triangulation.all_views import triangulate_views
from posefuse.model.cameras import CameraRig
from tests.kernels import from_python
from tests.reference import points as naive
from tests.scenes import LENSES, body_points, build_rig, camera_with, ring

solve_symmetric = from_python(symmetric_3x3.solve_symmetric)
invert_symmetric = from_python(symmetric_3x3.invert_symmetric)
judge_geometry = from_python(points.judge_geometry)

pytestmark = pytest.mark.no_jit


def triangulate(
    rig: CameraRig,
    pixels: np.ndarray,
    confidence: np.ndarray | None = None,
    *,
    min_views: int = 2,
    scale_px: float = 2.0,
    exponent: float = 0.0,
    min_confidence: float = 0.0,
    rows: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Run the kernel on pixels (frame, view, keypoint, 2)."""
    n, views, keypoints, _ = pixels.shape
    trust = np.full(pixels.shape[:-1], 0.8) if confidence is None else confidence
    out = TriangulatedPoints.allocate(n, keypoints, views)
    triangulate_views(
        rig.packed,
        Observations(
            kernel_array(pixels.reshape(-1, keypoints, 2)),
            kernel_array(trust.reshape(-1, keypoints)),
            np.arange(n * views).reshape(n, views) if rows is None else rows,
        ),
        NoiseParameters(kernel_array(np.full(views, scale_px)), exponent, min_confidence),
        min_views,
        out,
    )
    return out._asdict()


def noisy(rig: CameraRig, points_m: np.ndarray, rng: np.random.Generator, sigma_px: float = 2.0) -> np.ndarray:
    pixels = rig.project(points_m)
    return pixels + sigma_px * rng.standard_normal(pixels.shape)


@pytest.mark.parametrize("lens", LENSES)
def test_points_are_the_maximum_likelihood_points(lens, rng):
    rig = ring(5, lens)
    truth = body_points(rng, 3, 7)
    pixels = noisy(rig, truth, rng)
    out = triangulate(rig, pixels)
    assert (out["status"] == status_codes.POINT_OK).all()
    for f in range(3):
        for k in range(7):
            expected, covariance = naive.maximum_likelihood_point(
                rig.cameras, pixels[f, :, k], np.full(5, 2.0), truth[f, k]
            )
            deviation = np.sqrt(np.diag(covariance))
            # The lens is linearized at the observed pixel, which moves the point by a small fraction of its error.
            close = 2e-3 if lens == "pinhole" else 0.1
            np.testing.assert_array_less(np.abs(out["points"][f, k] - expected), close * deviation)
            packed = covariance[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
            np.testing.assert_allclose(out["covariance"][f, k], packed, rtol=0.05, atol=0.02 * deviation.max() ** 2)


def test_noise_free_points_come_back_exactly(rng):
    rig = ring(4, "barrel")
    truth = body_points(rng, 4, 9)
    out = triangulate(rig, noisy(rig, truth, rng, 0.0))
    np.testing.assert_allclose(out["points"], truth, atol=1e-7)
    np.testing.assert_allclose(out["view_errors_px"], 0.0, atol=1e-4)


def test_unused_lens_code_does_not_change_results(rng):
    rig = ring(4)
    pixels = noisy(rig, body_points(rng, 3, 5), rng)
    mixed = CameraRig((*rig.cameras, *(replace(ring(4, lens).cameras[0], name=lens) for lens in ("barrel", "fisheye"))))
    unseen = np.concatenate([pixels, np.full_like(pixels[:, :2], np.nan)], axis=1)
    alone, among = triangulate(rig, pixels), triangulate(mixed, unseen)
    for name in ("points", "covariance", "status", "mean_errors_px"):
        np.testing.assert_array_equal(alone[name], among[name])
    np.testing.assert_array_equal(alone["view_errors_px"], among["view_errors_px"][..., :4])


def test_view_errors_are_true_pixel_distances(rng):
    rig = ring(4, "barrel")
    truth = body_points(rng, 2, 5)
    pixels = noisy(rig, truth, rng, 5.0)
    out = triangulate(rig, pixels)
    projected = rig.project(out["points"])
    expected = np.linalg.norm(projected - pixels, axis=-1)
    np.testing.assert_allclose(np.moveaxis(out["view_errors_px"], -1, 1), expected, rtol=1e-5)


@pytest.mark.parametrize("n", [1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 5])
def test_results_do_not_depend_on_blocks(n, rng):
    rig = ring(3)
    truth = body_points(rng, n, 1)
    pixels = noisy(rig, truth, rng)
    whole = triangulate(rig, pixels)
    for f in {0, n // 2, n - 1}:
        alone = triangulate(rig, pixels[f : f + 1])
        for name in whole:
            np.testing.assert_array_equal(whole[name][f], alone[name][0])


class TestStatus:
    @pytest.fixture
    def scene(self, rng):
        rig = ring(5)
        truth = body_points(rng, 1, 4)
        return rig, noisy(rig, truth, rng, 1.0)

    def test_too_few_views(self, scene):
        rig, pixels = scene
        pixels[0, 1:, 0] = np.nan
        pixels[0, 2:, 1] = np.nan
        pixels[0, :, 2] = np.nan
        out = triangulate(rig, pixels, min_views=3)
        expected = [
            status_codes.POINT_TOO_FEW_VIEWS,
            status_codes.POINT_TOO_FEW_VIEWS,
            status_codes.POINT_NOT_SEEN,
            status_codes.POINT_OK,
        ]
        assert out["status"][0].tolist() == expected
        assert np.isnan(out["points"][0, :3]).all()
        assert np.isnan(out["covariance"][0, :3]).all()
        assert np.isnan(out["view_errors_px"][0, :3]).all()
        assert out["view_codes"][0, 0].tolist() == [status_codes.VIEW_NOT_USED] + [status_codes.VIEW_UNSEEN] * 4

    def test_two_views_have_their_own_status(self, scene):
        rig, pixels = scene
        pixels[0, 2:, 1] = np.nan
        out = triangulate(rig, pixels, min_views=2)
        assert out["status"][0, 1] == status_codes.POINT_TWO_VIEWS
        assert out["status"][0, 0] == status_codes.POINT_OK

    def test_low_confidence_is_not_used_but_has_an_error(self, scene):
        rig, pixels = scene
        confidence = np.full(pixels.shape[:-1], 0.8)
        confidence[0, 3, 0] = 0.1
        pixels[0, 3, 0] += 100.0
        out = triangulate(rig, pixels, confidence, min_confidence=0.2)
        without = pixels.copy()
        without[0, 3, 0] = np.nan
        np.testing.assert_allclose(out["points"], triangulate(rig, without)["points"], atol=1e-12)
        assert out["view_codes"][0, 0, 3] == status_codes.VIEW_LOW_CONFIDENCE
        assert out["view_errors_px"][0, 0, 3] == pytest.approx(141.4, abs=10)

    def test_unknown_confidence_counts_as_full(self, scene):
        rig, pixels = scene
        unknown = np.full(pixels.shape[:-1], np.nan)
        out = triangulate(rig, pixels, unknown, min_confidence=0.5, exponent=1.0)
        expected = triangulate(rig, pixels, np.ones(pixels.shape[:-1]), exponent=1.0)
        np.testing.assert_array_equal(out["points"], expected["points"])

    def test_incomplete_pixel_is_missing(self, scene):
        rig, pixels = scene
        pixels[0, 0, 0, 1] = np.nan
        out = triangulate(rig, pixels)
        assert out["view_codes"][0, 0, 0] == status_codes.VIEW_UNSEEN

    def test_diverging_rays_are_behind_the_camera(self):
        poses = np.eye(4), np.eye(4)
        poses[1][0, 3] = -1.0
        rig = CameraRig(tuple(camera_with("pinhole", f"cam_{i}", pose) for i, pose in enumerate(poses)))
        # The left camera observes the point farther left than the right one.
        pixels = np.array([[[[900.0, 540.0]], [[1000.0, 540.0]]]])
        out = triangulate(rig, pixels)
        assert out["status"][0, 0] == status_codes.POINT_BEHIND_CAMERA
        assert np.isnan(out["points"]).all()

    def test_one_camera_center_determines_no_point(self, rng):
        one = ring(2).cameras[0]
        rig = CameraRig((one, type(one)("twin", one.size_px, one.matrix, one.camera_from_world)))
        pixels = np.full((1, 2, 1, 2), 700.0)
        assert triangulate(rig, pixels)["status"][0, 0] == status_codes.POINT_DEGENERATE

    def test_one_camera_center_determines_no_point_with_noise(self, rng):
        one = ring(2).cameras[0]
        twins = [type(one)(f"twin_{i}", one.size_px, one.matrix, one.camera_from_world) for i in range(3)]
        rig = CameraRig(tuple(twins))
        out = triangulate(rig, noisy(rig, body_points(rng, 50, 4), rng))
        assert (out["status"] >= status_codes.POINT_MISSING).all()

    @pytest.mark.parametrize(
        ("apart_m", "expected"), [(0.02, status_codes.POINT_DEGENERATE), (0.1, status_codes.POINT_WEAK_GEOMETRY)]
    )
    def test_nearly_parallel_rays_have_a_status(self, apart_m, expected, rng):
        poses = np.stack([np.eye(4)] * 2)
        poses[1, 0, 3] = -apart_m
        rig = CameraRig(tuple(camera_with("pinhole", f"cam_{i}", pose) for i, pose in enumerate(poses)))
        truth = rng.uniform([-1, -1, 4.5], [1, 1, 5.5], (200, 1, 3))
        out = triangulate(rig, noisy(rig, truth, rng, 2.0))
        assert (out["status"] == expected).mean() > 0.75
        assert (out["status"] >= status_codes.POINT_TWO_VIEWS).mean() > 0.99

    def test_point_just_beyond_the_fold_has_errors(self):
        rig = build_rig("ring", 4, "barrel")
        pixels = np.array([[1825.77, 639.55], [111.71, 688.24], [643.61, 464.68], [1437.14, 416.14]])
        out = triangulate(rig, pixels.reshape(1, 4, 1, 2))
        assert out["status"][0, 0] == status_codes.POINT_OK
        assert np.isnan(rig.project(out["points"])).any()
        assert (out["view_codes"] == status_codes.VIEW_USED).all()
        assert np.isfinite(out["view_errors_px"]).all()
        assert np.isfinite(out["mean_errors_px"]).all()

    def test_confidence_zero_is_not_used(self, scene):
        rig, pixels = scene
        confidence = np.full(pixels.shape[:-1], 0.8)
        confidence[0, :2, 0] = 0.0
        out = triangulate(rig, pixels, confidence, exponent=1.0)
        assert out["view_codes"][0, 0].tolist() == [status_codes.VIEW_LOW_CONFIDENCE] * 2 + [status_codes.VIEW_USED] * 3

    def test_beyond_the_lens(self, rng):
        rig = ring(4, "barrel")
        pixels = noisy(rig, body_points(rng, 1, 1), rng)
        pixels[0, 2, 0] = [3000.0, 500.0]
        out = triangulate(rig, pixels)
        assert out["view_codes"][0, 0].tolist() == [0, 0, status_codes.VIEW_BEYOND_LENS, 0]

    def test_views_without_the_frame_or_the_person(self, scene):
        rig, pixels = scene
        rows = np.array([[0, status_codes.NO_DETECTION, 2, status_codes.NOT_RECORDED, 4]])
        out = triangulate(rig, pixels, rows=rows)
        assert out["view_codes"][0, 0].tolist() == [0, status_codes.VIEW_UNSEEN, 0, status_codes.VIEW_NOT_RECORDED, 0]


def test_confidence_weights_views(rng):
    """With sigma in proportion to 1 / c the weighted point equals the maximum-likelihood point of that noise."""
    rig = ring(4)
    truth = body_points(rng, 2, 3)
    confidence = rng.uniform(0.2, 1.0, (2, 4, 3))
    pixels = rig.project(truth)
    pixels = pixels + (2.0 / confidence)[..., None] * rng.standard_normal(pixels.shape)
    out = triangulate(rig, pixels, confidence, exponent=1.0)
    for f in range(2):
        for k in range(3):
            expected, _ = naive.maximum_likelihood_point(
                rig.cameras, pixels[f, :, k], 2.0 / confidence[f, :, k], truth[f, k]
            )
            np.testing.assert_allclose(out["points"][f, k], expected, atol=5e-5)


def test_points_far_from_the_origin_keep_precision(rng):
    """Points a thousand kilometers from the origin are as accurate as near it, up to floating-point precision."""
    rig = ring(4)
    offset = np.array([5e5, -8e5, 100.0])
    moved = CameraRig(
        tuple(
            type(c)(c.name, c.size_px, c.matrix, _moved(c.camera_from_world, offset), c.lens, c.distortion)
            for c in rig.cameras
        )
    )
    truth = body_points(rng, 2, 3)
    pixels = noisy(rig, truth, rng)
    near, far = triangulate(rig, pixels), triangulate(moved, pixels)
    np.testing.assert_allclose(far["points"] - offset, near["points"], atol=1e-4)


def _moved(pose: np.ndarray, offset: np.ndarray) -> np.ndarray:
    out = pose.copy()
    out[:3, 3] -= pose[:3, :3] @ offset
    return out


def test_symmetric_solver_and_inverse(rng):
    for _ in range(50):
        a = rng.standard_normal((5, 3))
        matrix = a.T @ a
        packed = matrix[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        right = rng.standard_normal(3)
        solved, *x = solve_symmetric(*packed, *right)
        assert solved
        np.testing.assert_allclose(matrix @ x, right, atol=1e-9)
        ok, *inverse = invert_symmetric(*packed)
        assert ok
        np.testing.assert_allclose(np.array(inverse)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]] @ matrix, np.eye(3), atol=1e-8)
    flat = np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    with np.errstate(all="ignore"):
        assert not solve_symmetric(*flat, 1.0, 1.0, 1.0)[0]


def test_weak_geometry_does_not_replace_a_worse_status():
    state, sums = np.zeros((points.STATE_ROWS, BLOCK)), np.zeros((points.SUM_ROWS, BLOCK))
    state[[points.INFORMATION, points.INFORMATION + 3, points.INFORMATION + 5]] = 100.0
    sums[points.DEPTH] = 1.0
    status = np.full(BLOCK, status_codes.POINT_OK)
    status[1:4] = status_codes.POINT_TWO_VIEWS, status_codes.POINT_AMBIGUOUS, status_codes.POINT_NOT_SEEN
    judge_geometry(state, sums, status)
    weak = status_codes.POINT_WEAK_GEOMETRY
    assert status[:4].tolist() == [weak, weak, status_codes.POINT_AMBIGUOUS, status_codes.POINT_NOT_SEEN]
