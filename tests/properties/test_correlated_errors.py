"""Paths under correlated errors do not depend on coordinates, units, orders or the direction of time."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from posefuse.model.cameras import CameraRig
from posefuse.model.reconstruction import Layer
from posefuse.skeleton.skeletons import Skeleton
from tests.scenes import ring
from tests.unit.trajectory.path_problems import ARM, RATE_HZ, exact_pixels, measured, solved, swinging
from tests.unit.trajectory.test_solve import lasting, moved_rig

TRUTH = swinging(160)
PIXELS = exact_pixels(ring(4), TRUTH) + lasting(TRUTH, 0.1, 3)
REORDERED = [2, 0, 1]


def arrays(layer: Layer) -> tuple[np.ndarray, np.ndarray]:
    """Return points, shape (frame, keypoint, 3), and the traces of their covariances, shape (frame, keypoint)."""
    return np.asarray(layer.points_m)[:, 0], np.asarray(layer.covariance_m2)[:, 0][..., [0, 3, 5]].sum(axis=-1)


@pytest.fixture(scope="module")
def expected() -> tuple[np.ndarray, np.ndarray]:
    return arrays(solved(measured(TRUTH, pixels=PIXELS)))


def in_another_world() -> tuple[np.ndarray, np.ndarray]:
    """Rotate the world, and move its origin by more than a kilometer."""
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn * np.linalg.det(turn), (1000.0, -2000.0, 500.0)
    points, variance = arrays(solved(measured(TRUTH, rig=moved_rig(ring(4), pose), pixels=PIXELS)))
    return points @ pose[:3, :3].T + pose[:3, 3], variance


def in_millimeters() -> tuple[np.ndarray, np.ndarray]:
    cameras = []
    for camera in ring(4).cameras:
        pose = camera.camera_from_world.copy()
        pose[:3, 3] *= 1000.0
        cameras.append(replace(camera, camera_from_world=pose))
    rig: CameraRig = replace(ring(4), cameras=tuple(cameras))
    points, variance = arrays(solved(measured(TRUTH, rig=rig, pixels=PIXELS)))
    return points / 1e3, variance / 1e6


def with_other_cameras_first() -> tuple[np.ndarray, np.ndarray]:
    rig = replace(ring(4), cameras=ring(4).cameras[::-1])
    return arrays(solved(measured(TRUTH, rig=rig, pixels=PIXELS[:, ::-1])))


def with_other_keypoints_first() -> tuple[np.ndarray, np.ndarray]:
    skeleton = Skeleton("arm", tuple(ARM.keypoints[i] for i in REORDERED), ARM.edges)
    found = solved(measured(TRUTH[:, REORDERED], pixels=PIXELS[:, :, REORDERED], skeleton=skeleton))
    points, variance = arrays(found)
    back = np.argsort(REORDERED)
    return points[:, back], variance[:, back]


def backward() -> tuple[np.ndarray, np.ndarray]:
    points, variance = arrays(solved(measured(TRUTH, pixels=PIXELS[::-1])))
    return points[::-1], variance[::-1]


def a_day_later() -> tuple[np.ndarray, np.ndarray]:
    time_s = 86400.0 + np.arange(len(TRUTH)) / RATE_HZ
    return arrays(solved(measured(TRUTH, pixels=PIXELS, time_s=time_s)))


@pytest.mark.parametrize(
    "solve_again",
    [
        in_another_world,
        in_millimeters,
        with_other_cameras_first,
        with_other_keypoints_first,
        backward,
        a_day_later,
    ],
)
def test_paths_are_the_same(
    solve_again: Callable[[], tuple[np.ndarray, np.ndarray]], expected: tuple[np.ndarray, np.ndarray]
) -> None:
    points, variance = solve_again()
    np.testing.assert_allclose(points, expected[0], atol=1e-7, rtol=0.0)
    np.testing.assert_allclose(variance, expected[1], rtol=1e-4)
