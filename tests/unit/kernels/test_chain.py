"""Kernels of the anatomical chain against 4 x 4 matrices and finite differences."""

import numpy as np
import pytest

from posefuse.biomechanics.anatomy.anatomy import Anatomy, read_anatomy
from posefuse.kernels.biomechanics.chain import marker_jacobians
from tests.reference import anatomical_chain as naive

pytestmark = pytest.mark.no_jit

STEP = 1e-6


def random_pose(anatomy: Anatomy, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return scale factors and coordinates, some of them beyond the ends of the knee splines."""
    rng = np.random.default_rng(seed)
    low, high = anatomy.ranges.T
    return rng.uniform(0.7, 1.4, (len(anatomy.bodies), 3)), rng.uniform(low - 0.3, high + 0.3)


def markers_of(anatomy: Anatomy, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return one marker on every body."""
    return np.arange(len(anatomy.bodies)), np.random.default_rng(seed).normal(0.0, 0.1, (len(anatomy.bodies), 3))


@pytest.mark.parametrize("seed", range(4))
def test_poses_equal_products_of_matrices(seed: int) -> None:
    anatomy = read_anatomy()
    scales, q = random_pose(anatomy, seed)
    rotations, origins = anatomy.body_poses(scales, q[None])
    expected = naive.body_poses(anatomy, scales, q)
    np.testing.assert_allclose(rotations[0], expected[:, :3, :3], atol=1e-12)
    np.testing.assert_allclose(origins[0], expected[:, :3, 3], atol=1e-12)


def test_markers_move_with_their_scaled_bodies() -> None:
    anatomy = read_anatomy()
    scales, q = random_pose(anatomy, 5)
    bodies, locations = markers_of(anatomy, 6)
    positions = anatomy.marker_positions(scales, q[None], bodies, locations)[0]
    poses = naive.body_poses(anatomy, scales, q)
    expected = np.einsum("kij,kj->ki", poses[:, :3, :3], scales * locations) + poses[:, :3, 3]
    np.testing.assert_allclose(positions, expected, atol=1e-12)


def test_jacobians_equal_finite_differences() -> None:
    anatomy = read_anatomy()
    scales, q = random_pose(anatomy, 7)
    bodies, locations = markers_of(anatomy, 8)
    k, b, c = len(bodies), len(anatomy.bodies), len(anatomy.coordinates)
    positions, by_coordinate, by_scale = np.empty((k, 3)), np.empty((k, 3, c)), np.empty((k, 3, b, 3))
    markers = (bodies, locations, positions)
    marker_jacobians(anatomy.chain, scales, q, anatomy.new_state(), markers, by_coordinate, by_scale)
    np.testing.assert_allclose(positions, anatomy.marker_positions(scales, q[None], bodies, locations)[0], atol=1e-12)

    steps = STEP * np.eye(c)
    ahead, behind = (anatomy.marker_positions(scales, q + sign * steps, bodies, locations) for sign in (1, -1))
    np.testing.assert_allclose(by_coordinate, np.moveaxis(ahead - behind, 0, -1) / (2 * STEP), atol=1e-7)
    for body in range(b):
        for axis in range(3):
            moved = [scales.copy(), scales.copy()]
            moved[0][body, axis] += STEP
            moved[1][body, axis] -= STEP
            ahead, behind = (anatomy.marker_positions(s, q[None], bodies, locations)[0] for s in moved)
            np.testing.assert_allclose(by_scale[:, :, body, axis], (ahead - behind) / (2 * STEP), atol=1e-7)


def test_a_missing_coordinate_leaves_the_bodies_before_it() -> None:
    anatomy = read_anatomy()
    q = anatomy.defaults.copy()
    q[anatomy.coordinate_index("knee_angle_r")] = np.nan
    _, origins = anatomy.body_poses(anatomy.unscaled(), q[None])
    assert np.isfinite(origins[0, anatomy.body_index("femur_r")]).all()
    assert np.isnan(origins[0, anatomy.body_index("calcn_r")]).all()
    assert np.isfinite(origins[0, anatomy.body_index("calcn_l")]).all()
