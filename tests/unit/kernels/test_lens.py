"""Lens models against the reference, OpenCV and finite differences, and at the fold."""

import cv2
import numpy as np
import pytest

from posefuse.kernels.cameras import lens as kernels
from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.cameras.observation_rows import rows_block as rows_step
from posefuse.model.cameras import Camera, LensModel
from tests.kernels import from_python
from tests.reference import lens as naive
from tests.scenes import LENSES, MATRIX, camera_with

distort = from_python(kernels.distort)
project_jacobian = from_python(kernels.project_jacobian)
undistort_normalized = from_python(kernels.undistort_normalized)
rows_block = from_python(rows_step)

pytestmark = pytest.mark.no_jit


def points_in_view(camera: Camera, rng: np.random.Generator, n: int = 200) -> np.ndarray:
    """Points in front of the camera, up to nine tenths of the fold."""
    most = min(0.9 * camera.packed[kernels.MAX_RADIUS], 1.2)
    radius, angle, depth = rng.uniform(0, most, n), rng.uniform(0, 2 * np.pi, n), rng.uniform(1, 8, n)
    if camera.lens is LensModel.FISHEYE:
        return depth[:, None] * np.stack(
            [np.sin(radius) * np.cos(angle), np.sin(radius) * np.sin(angle), np.cos(radius)], axis=1
        )
    return depth[:, None] * np.stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(n)], axis=1)


@pytest.mark.parametrize("lens", LENSES)
def test_projection_agrees_with_the_reference(lens, rng):
    camera = camera_with(lens)
    points = points_in_view(camera, rng)
    pixels, codes = camera.project(points)
    assert (codes == kernels.OK).all()
    np.testing.assert_allclose(pixels, [naive.project(camera, point) for point in points], rtol=0, atol=1e-9)


@pytest.mark.parametrize("lens", LENSES)
def test_rays_agree_with_the_reference(lens, rng):
    camera = camera_with(lens)
    pixels, _ = camera.project(points_in_view(camera, rng, 60))
    directions, codes = camera.rays(pixels)
    assert (codes == kernels.OK).all()
    limit = min(float(camera.packed[kernels.MAX_RADIUS]), np.pi)
    expected = [naive.ray(camera, pixel, limit) for pixel in pixels]
    np.testing.assert_allclose(directions, expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("lens", LENSES)
def test_rays_invert_projection(lens, rng):
    camera = camera_with(lens)
    points = points_in_view(camera, rng)
    directions, _ = camera.rays(camera.project(points)[0])
    np.testing.assert_allclose(directions, points / np.linalg.norm(points, axis=1, keepdims=True), rtol=0, atol=1e-9)


@pytest.mark.parametrize("lens", [name for name in LENSES if name != "fisheye"])
def test_projection_agrees_with_opencv(lens, rng):
    camera = camera_with(lens)
    points = points_in_view(camera, rng)
    coefficients = np.array(camera.distortion or (0.0,) * 5)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, coefficients)
    np.testing.assert_allclose(camera.project(points)[0], expected[:, 0], rtol=0, atol=1e-9)


def test_fisheye_projection_agrees_with_opencv(rng):
    camera = camera_with("fisheye")
    points = points_in_view(camera, rng)
    expected, _ = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion)
    )
    np.testing.assert_allclose(camera.project(points)[0], expected[:, 0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("lens", LENSES)
def test_jacobian_of_projection_agrees_with_finite_differences(lens, rng):
    camera = camera_with(lens)
    step = 1e-6
    for point in points_in_view(camera, rng, 40):
        status, *derivative = project_jacobian(camera.packed[None], 0, *point)
        assert status == kernels.OK
        numeric = np.empty((2, 3))
        for axis in range(3):
            offset = step * np.eye(3)[axis]
            high, low = camera.project(point + offset)[0], camera.project(point - offset)[0]
            numeric[:, axis] = (high - low) / (2 * step)
        np.testing.assert_allclose(np.reshape(derivative, (2, 3)), numeric, rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize("lens", ["mild", "barrel", "pincushion", "rational"])
def test_jacobian_of_undistortion_is_that_of_distortion_at_the_solution(lens, rng):
    camera = camera_with(lens)
    packed = camera.packed[None]
    for x, y in points_in_view(camera, rng, 40)[:, :2] / 8:
        x_d, y_d, *_ = distort(packed, 0, x, y)
        status, u, v, a, b, c, d = undistort_normalized(packed, 0, x_d, y_d)
        assert status == kernels.OK
        np.testing.assert_allclose((u, v), (x, y), atol=1e-10)
        step = 1e-6
        columns = [
            np.subtract(distort(packed, 0, x + dx, y + dy)[:2], distort(packed, 0, x - dx, y - dy)[:2]) / (2 * step)
            for dx, dy in ((step, 0.0), (0.0, step))
        ]
        np.testing.assert_allclose([[a, b], [c, d]], np.transpose(columns), atol=1e-6)


@pytest.mark.parametrize("lens", LENSES)
def test_rows_reproduce_the_residual_to_first_order(lens, rng):
    """The rows' residual equals observed minus projected, exactly for a pinhole, to first order with a lens."""
    camera = camera_with(lens)
    points = points_in_view(camera, rng, BLOCK)
    pixels = camera.project(points)[0]
    offset = 0.5 * rng.standard_normal(pixels.shape)
    observed = np.ascontiguousarray((pixels + offset).T)[None]
    codes = np.empty((1, BLOCK), dtype=np.int64)
    rows = np.empty((1, 12, BLOCK))
    rows_of(camera, observed, codes, rows)
    assert (codes == kernels.OK).all()
    homogeneous = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    depth = np.einsum("ij,ji->i", homogeneous, rows[0, 8:12])
    assert (depth > 0).all()
    residual = np.stack([np.einsum("ij,ji->i", homogeneous, rows[0, i : i + 4]) / depth for i in (0, 4)], axis=1)
    exact = lens == "pinhole"
    np.testing.assert_allclose(residual, -offset, rtol=1e-9 if exact else 0.02, atol=1e-9 if exact else 0.01)


def rows_of(camera: Camera, pixels: np.ndarray, codes: np.ndarray, rows: np.ndarray) -> None:
    rows_block(camera.packed[None], 0, pixels, codes, rows, np.empty((6, BLOCK)))


@pytest.mark.parametrize("lens", LENSES)
def test_missing_pixels_have_no_ray(lens):
    camera = camera_with(lens)
    pixels = np.array([[np.nan, 500.0], [500.0, np.nan], [np.inf, 500.0], [900.0, 500.0]])
    directions, codes = camera.rays(pixels)
    assert codes.tolist() == [kernels.MISSING] * 3 + [kernels.OK]
    assert np.isnan(directions[:3]).all()


@pytest.mark.parametrize("lens", LENSES)
def test_missing_and_hidden_points_have_no_pixel(lens):
    camera = camera_with(lens)
    points = np.array([[np.nan, 0, 1], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    pixels, codes = camera.project(points)
    assert codes.tolist() == [kernels.MISSING, kernels.BEHIND, kernels.BEHIND]
    assert np.isnan(pixels).all()


def test_fisheye_projects_beyond_ninety_degrees():
    camera = camera_with("fisheye")
    angle = np.radians(100)
    point = np.array([np.sin(angle), 0.0, np.cos(angle)])
    pixel, code = camera.project(point)
    assert code == kernels.OK
    np.testing.assert_allclose(camera.rays(pixel)[0], point, atol=1e-10)


class TestFold:
    """Beyond the fold of a lens model, results are undefined."""

    def test_barrel_folds_where_the_slope_vanishes(self):
        camera = camera_with("barrel")
        assert camera.packed[kernels.MAX_RADIUS] == pytest.approx(1 / np.sqrt(3 * 0.28), rel=1e-12)

    @pytest.mark.parametrize("lens", [*LENSES, "double"])
    def test_fold_agrees_with_a_radial_scan(self, lens):
        camera = (
            Camera("c", (1920, 1080), MATRIX, np.eye(4), LensModel.RATIONAL, (0.1, -0.3, 0, 0, 0.02, 0.2, 0.1, -0.05))
            if lens == "double"
            else camera_with(lens)
        )
        furthest = np.pi if lens == "fisheye" else 20.0
        found, expected = float(camera.packed[kernels.MAX_RADIUS]), naive.fold_radius(camera, furthest)
        if np.isfinite(expected):
            assert found == pytest.approx(expected, abs=2e-4)
        else:
            assert found >= furthest - 1e-9

    @pytest.mark.parametrize("share", [0.5, 0.9, 0.999])
    def test_projection_and_rays_agree_inside_the_fold(self, share):
        camera = camera_with("barrel")
        radius = share * camera.packed[kernels.MAX_RADIUS]
        point = np.array([radius * np.cos(0.3), radius * np.sin(0.3), 1.0])
        pixel, code = camera.project(point)
        assert code == kernels.OK
        direction, code = camera.rays(pixel)
        assert code == kernels.OK
        # Near the fold the image hardly moves, so the inverse loses precision in proportion.
        np.testing.assert_allclose(direction / direction[2], point, atol=1e-9 / (1 - share))

    @pytest.mark.parametrize("share", [1.001, 1.2, 3.0])
    def test_projection_beyond_the_fold_has_a_status(self, share):
        camera = camera_with("barrel")
        pixel, code = camera.project(np.array([share * camera.packed[kernels.MAX_RADIUS], 0.0, 1.0]))
        assert code == kernels.BEYOND
        assert np.isnan(pixel).all()

    @pytest.mark.parametrize("lens", ["barrel", "fisheye"])
    def test_pixels_no_point_projects_to_have_no_ray(self, lens):
        camera = Camera(
            "c", (1920, 1080), MATRIX, np.eye(4), *{"barrel": (LensModel.BROWN, (-0.28, 0, 0, 0, 0)),
            "fisheye": (LensModel.FISHEYE, (-0.2, 0, 0, 0))}[lens]
        )  # fmt: skip
        most = camera.packed[kernels.MAX_RADIUS]
        edge = most * (1 - 0.28 * most**2) if lens == "barrel" else most * (1 - 0.2 * most**2)
        for share, code in ((0.999, kernels.OK), (1.001, kernels.BEYOND), (2.0, kernels.BEYOND)):
            pixel = np.array([MATRIX[0, 2] + share * edge * MATRIX[0, 0], MATRIX[1, 2]])
            direction, found = camera.rays(pixel)
            assert found == code, share
            assert np.isnan(direction).all() == (code != kernels.OK)

    def test_blocks_and_single_pixels_agree_across_the_fold(self, rng):
        camera = camera_with("barrel")
        pixels = rng.uniform([-600, -600], [2500, 1700], (BLOCK, 2))
        _, expected = camera.rays(pixels)
        codes = np.empty((1, BLOCK), dtype=np.int64)
        rows = np.empty((1, 12, BLOCK))
        rows_of(camera, np.ascontiguousarray(pixels.T)[None], codes, rows)
        assert set(expected) == {kernels.OK, kernels.BEYOND}
        np.testing.assert_array_equal(codes[0], expected)
        silent = codes[0] != kernels.OK
        np.testing.assert_array_equal(rows[0, :11][:, silent], 0.0)
