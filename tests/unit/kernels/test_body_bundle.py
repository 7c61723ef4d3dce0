"""Kernels of the bundle adjustment of bodies against naive twins."""

import numpy as np
import pytest

from posefuse.kernels.calibration.body_bundle import (
    CENTER,
    FOCAL,
    OFFSET,
    VIEW_COLUMNS,
    body_residuals,
    body_terms,
    eliminate_points,
    refine_view,
    step_of_points,
)
from posefuse.kernels.calibration.ray_points import triangulate_rays
from posefuse.model.cameras import rotation_from_vector

N_VIEWS, N_SAMPLES, N_KEYPOINTS = 3, 2, 4
ENDS = np.array([[0, 1], [2, 3]])
SDS = np.array([0.05, 0.1])


def unit(values):
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


@pytest.fixture
def scene(rng):
    """Return rotations, centers, points, logarithmic lengths and observations with errors."""
    rotations = np.stack([rotation_from_vector(0.5 * rng.standard_normal(3)) for _ in range(N_VIEWS)])
    centers = np.stack([-rotation.T @ [0.0, 0.0, 5.0] for rotation in rotations]) + 0.2 * rng.standard_normal((3, 3))
    points = rng.uniform(-0.8, 0.8, (N_SAMPLES, N_KEYPOINTS, 3))
    observed = np.zeros((N_SAMPLES, N_VIEWS, N_KEYPOINTS, 10))
    exact = np.einsum("vij,svkj->svki", rotations, points[:, None] - centers[:, None])
    observed[..., :3] = unit(unit(exact) + 0.004 * rng.standard_normal(exact.shape))
    observed[..., 3:6] = 0.1 * rng.standard_normal(exact.shape)
    off_axis = observed[..., :3] * [1.0, 1.0, 0.0]
    observed[..., 6:9] = observed[..., :3] * (off_axis**2).sum(axis=-1, keepdims=True) - off_axis
    observed[..., 9] = 0.005
    observed[0, 1, 2] = np.nan
    return rotations, centers, points, rng.normal(-0.2, 0.1, (N_SAMPLES, 2)), observed


def terms(scene):
    """Return cost, matrices of points, mixed terms, matrix and gradient; both samples share the lengths."""
    rotations, centers, points, log_lengths, observed = scene
    size = N_VIEWS * VIEW_COLUMNS + 2
    out = (
        np.zeros((N_SAMPLES, 3 * N_KEYPOINTS, 3 * N_KEYPOINTS)),
        np.zeros((N_SAMPLES, 3 * N_KEYPOINTS, size + 1)),
        np.zeros((size, size + 1)),
    )
    columns = np.tile(np.array([size - 2, size - 1]), (N_SAMPLES, 1))
    bones = (ENDS, SDS, columns)
    cost = body_terms(rotations, centers, points, log_lengths, observed, np.ones(N_VIEWS), bones, out)
    return cost, out[0], out[1], out[2][:, :-1], out[2][:, -1]


def moved(scene, view, column, step):
    """Return the scene after a small change of one parameter of a view."""
    rotations, centers, points, log_lengths, observed = (part.copy() for part in scene)
    if column < CENTER:
        rotations[view] = rotation_from_vector(step * np.eye(3)[column]) @ rotations[view]
    elif column < OFFSET:
        centers[view, column - CENTER] += step
    elif column == OFFSET:
        observed[:, view, :, :3] = unit(observed[:, view, :, :3] + step * observed[:, view, :, 3:6])
    else:
        observed[:, view, :, :2] *= np.exp(-step)
        observed[:, view, :, :3] = unit(observed[:, view, :, :3])
        observed[:, view, :, 9] *= np.exp(-step)
    return rotations, centers, points, log_lengths, observed


@pytest.mark.parametrize("column", range(VIEW_COLUMNS))
def test_gradient_by_views_is_that_of_the_cost(scene, column):
    gradient = terms(scene)[4]
    step = 1e-6
    for view in range(N_VIEWS):
        numeric = (terms(moved(scene, view, column, step))[0] - terms(moved(scene, view, column, -step))[0]) / (
            2 * step
        )
        # Velocities and focal lengths are linear: second order in the errors of about 0.005.
        tolerance = 0.03 if column in (OFFSET, FOCAL) else 1e-4
        assert gradient[view * VIEW_COLUMNS + column] == pytest.approx(numeric, rel=tolerance, abs=tolerance)


def test_gradients_by_points_and_lengths_are_those_of_the_cost(scene):
    _, _, mixed, _, gradient = terms(scene)
    rotations, centers, points, log_lengths, observed = scene
    step = 1e-6
    for s in range(N_SAMPLES):
        for i in range(3 * N_KEYPOINTS):
            change = np.zeros(points.size)
            change[s * 3 * N_KEYPOINTS + i] = step
            change = change.reshape(points.shape)
            costs = [terms((rotations, centers, points + sign * change, log_lengths, observed))[0] for sign in (1, -1)]
            assert mixed[s, i, -1] == pytest.approx((costs[0] - costs[1]) / (2 * step), rel=1e-4, abs=1e-4)
    for length in range(2):
        change = step * (np.arange(2) == length)
        costs = [terms((rotations, centers, points, log_lengths + sign * change, observed))[0] for sign in (1, -1)]
        assert gradient[-2 + length] == pytest.approx((costs[0] - costs[1]) / (2 * step), rel=1e-4)


def test_elimination_solves_the_whole_system(rng):
    n, rows, size = 3, 6, 4
    roots = rng.standard_normal((n, rows, rows + 2))
    matrices, mixed = roots @ roots.transpose(0, 2, 1), rng.standard_normal((n, rows, size + 1))
    matrix, gradient = 100.0 * np.eye(size), rng.standard_normal(size)
    whole = np.zeros((n * rows + size, n * rows + size))
    for s in range(n):
        place = slice(s * rows, (s + 1) * rows)
        whole[place, place] = matrices[s] + 0.1 * np.diag(np.diag(matrices[s]))
        whole[place, n * rows :] = mixed[s, :, :-1]
        whole[n * rows :, place] = mixed[s, :, :-1].T
    whole[n * rows :, n * rows :] = matrix
    expected = -np.linalg.solve(whole, np.concatenate([mixed[:, :, -1].ravel(), gradient]))
    reduced, steps = np.zeros((size + 1, size + 1)), np.empty((n, rows))
    factors = matrices.copy()
    eliminate_points(factors, mixed, 0.1, reduced)
    square = np.tril(reduced) + np.tril(reduced, -1).T
    change = -np.linalg.solve(matrix - square[:-1, :-1], gradient - square[-1, :-1])
    step_of_points(factors, mixed, change, steps)
    np.testing.assert_allclose(change, expected[n * rows :], rtol=1e-8)
    np.testing.assert_allclose(steps.ravel(), expected[: n * rows], rtol=1e-8)


def test_triangulation_and_residuals(scene):
    rotations, centers, points, _, observed = scene
    exact = np.einsum("vij,svkj->svki", rotations, points[:, None] - centers[:, None])
    observed[..., :3] = unit(exact)
    observed[0, :, 3] = np.nan
    observed[0, 0, 3, :3], observed[0, 0, 3, 9] = unit(exact)[0, 0, 3], 0.005
    found = np.empty_like(points)
    triangulate_rays(rotations, centers, observed, found)
    assert np.isnan(found[0, 3]).all()
    found[0, 3] = points[0, 3]
    np.testing.assert_allclose(found, points, atol=1e-9)
    residuals = np.empty(observed.shape[:3])
    body_residuals(rotations, centers, points + np.array([0.01, 0.0, 0.0]), observed, residuals)
    shift = np.einsum("vij,j->vi", rotations, [0.01, 0.0, 0.0])
    expected = np.linalg.norm(exact + shift[:, None], axis=-1, keepdims=True)
    sine = np.linalg.norm(np.cross(unit(exact), (exact + shift[:, None]) / expected), axis=-1)
    known = np.isfinite(residuals)
    assert known.sum() == N_SAMPLES * N_VIEWS * N_KEYPOINTS - 3
    np.testing.assert_allclose(residuals[known], (sine / np.sqrt(1.0 - sine**2) / 0.005)[known], rtol=1e-6)


def test_view_is_refined_from_known_points(rng):
    rotation, center = rotation_from_vector(np.array([0.2, -0.4, 0.1])), np.array([0.5, 0.2, -5.0])
    points = rng.uniform(-1.0, 1.0, (60, 3))
    observed = np.zeros((60, 10))
    observed[:, :3], observed[:, 9] = unit((points - center) @ rotation.T), 0.002
    observed[:10, :3] = unit(observed[:10, :3] + 0.3 * rng.standard_normal((10, 3)))
    found = rotation_from_vector(np.array([0.1, 0.15, -0.1])) @ rotation, center + np.array([0.4, -0.3, 0.5])
    refine_view(found[0], found[1], points, observed, 40)
    np.testing.assert_allclose(found[0], rotation, atol=2e-3)
    np.testing.assert_allclose(found[1], center, atol=1e-2)
