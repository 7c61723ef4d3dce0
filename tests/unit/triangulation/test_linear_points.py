"""Linear points against a naive solution, and the dependence on the unit of length."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from benchmarks.walking import walk

from posefuse.triangulation.linear_points import image_errors_px, linear_points, undistort, undistorted_errors_px
from tests.reference import rejection


@pytest.fixture(scope="module")
def data():
    return walk(3, 4, "barrel", outlier_share=0.1, missing_share=0.2, seed=3)


def per_point(data):
    return np.moveaxis(data.pixels, 2, 1).reshape(-1, len(data.rig), 2)


def test_points_equal_those_of_the_naive_solution(data):
    pixels = per_point(data)
    used = np.isfinite(pixels).all(axis=-1)
    points = linear_points(data.rig, undistort(data.rig, pixels), used)
    for point, seen, observed in zip(points, used, pixels, strict=True):
        views = np.flatnonzero(seen).tolist()
        expected = rejection.program_point(data.rig, observed, views) if len(views) > 1 else np.full(3, np.nan)
        np.testing.assert_allclose(point, expected, atol=1e-7)


def test_views_that_are_not_used_do_not_count(data):
    pixels = per_point(data)
    used = np.isfinite(pixels).all(axis=-1)
    used[:, 0] = False
    without = pixels.copy()
    without[:, 0] = np.nan
    expected = linear_points(data.rig, undistort(data.rig, without), used)
    np.testing.assert_array_equal(linear_points(data.rig, undistort(data.rig, pixels), used), expected)


def test_unit_of_the_calibration_changes_contradictory_points_only():
    wrong = walk(3, 4, outlier_share=0.3, seed=3)
    for data, least, most in ((walk(3, 4, sigma_px=0.0), 0.0, 1e-9), (wrong, 1e-4, np.inf)):
        pixels = per_point(data)
        used = np.ones(pixels.shape[:2], dtype=bool)
        both = [
            linear_points(rig, undistort(rig, pixels), used)
            for rig in (data.rig, replace(data.rig, meters_per_unit=0.001))
        ]
        assert least <= np.abs(both[0] - both[1]).max() <= most


def test_errors_of_a_pinhole_are_those_of_the_image():
    data = walk(3, 4, sigma_px=3.0)
    pixels = per_point(data)
    points = data.points_m.reshape(-1, 3)
    expected = np.linalg.norm(data.rig.project(points) - pixels, axis=-1)
    errors_px = undistorted_errors_px(data.rig, undistort(data.rig, pixels), points)
    np.testing.assert_allclose(errors_px, expected, rtol=1e-6)


def test_errors_equal_those_of_opencv_also_behind_a_camera(data):
    pixels = per_point(data)[:40]
    outside = np.random.default_rng(1).uniform(-0.3, 0.3, (20, 3)) + 2 * data.rig.cameras[0].center_m
    points = np.concatenate([data.points_m.reshape(-1, 3)[:20], outside])
    errors_px = image_errors_px(data.rig, pixels, points)
    camera = data.rig.cameras[0]
    assert ((points @ camera.rotation.T + camera.translation_m)[20:, 2] < 0).all()
    turn, _ = cv2.Rodrigues(camera.rotation)
    expected, _ = cv2.projectPoints(points, turn, camera.translation_m, camera.matrix, np.array(camera.distortion))
    distance = np.linalg.norm(expected[:, 0] - pixels[:, 0], axis=-1)
    np.testing.assert_allclose(errors_px[:, 0], distance, rtol=1e-6)
