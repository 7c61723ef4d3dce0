"""Weights of observations and their sums, compared with NumPy."""

import numpy as np
import pytest

from posefuse.kernels.cameras.linearize import LINEAR_ROWS, linearize, linearize_paths, residuals_px
from posefuse.kernels.cameras.observation_rows import BLOCK
from posefuse.kernels.trajectory.blocks import empty_blocks, from_blocks, matrices_from_blocks
from posefuse.kernels.trajectory.observation_terms import (
    PathSystem,
    ViewTerms,
    add_views,
    scale_residuals,
    weigh_observations,
    whiten_errors,
)
from posefuse.synthetic.rigs import build_rig

pytestmark = pytest.mark.no_jit
KEYPOINTS, FRAMES, VIEWS = 2, 19, 3


def problem(seed: int):
    """Return linearized observations with errors, one of them missing, in blocks and as residuals and derivatives."""
    rng = np.random.default_rng(seed)
    rig = build_rig("ring", VIEWS, "barrel")
    points = rng.normal(scale=0.3, size=(KEYPOINTS, FRAMES, 3)) + np.array([0.0, 0.0, 1.0])
    pixels = np.moveaxis(rig.project(points), 1, 2) + rng.normal(scale=3.0, size=(KEYPOINTS, FRAMES, VIEWS, 2))
    pixels[1, 4, 2] = np.nan
    linear = np.empty((KEYPOINTS, 2, VIEWS, LINEAR_ROWS * BLOCK))
    linearize_paths(rig.packed, points, pixels, linear)
    return rng, linear, *linearize(rig.packed, points, pixels)


def test_weights_fall_with_the_distance_from_the_path():
    rng, linear, residuals, jacobians = problem(1)
    sigma = rng.uniform(1.0, 2.0, residuals.shape[:3])
    sigma[0, 0, 0] = np.inf
    roots = rng.normal(scale=0.002, size=(KEYPOINTS, FRAMES, 3, 3))
    covariance = roots @ roots.swapaxes(-1, -2)
    weights, counts = np.empty(sigma.shape), np.empty(sigma.shape[:2], dtype=np.int64)
    weigh_observations(linear, sigma, covariance, 2.0, 4.0, weights, counts)
    projected = np.einsum("kfvai,kfij,kfvbj->kfvab", jacobians, covariance, jacobians)
    trace = np.trace(projected, axis1=-2, axis2=-1)
    projected *= np.minimum(1.0, 10.0 * np.square(sigma) / trace)[..., None, None]
    total = projected + np.square(np.where(np.isfinite(sigma), sigma, 1.0))[..., None, None] * np.eye(2)
    squared = np.einsum("kfva,kfvab,kfvb->kfv", residuals, np.linalg.inv(np.nan_to_num(total) + 1e-300), residuals)
    expected = np.nan_to_num(np.clip(1.0 - (squared - 4.0) / 12.0, 0.0, 1.0))
    expected[0, 0, 0] = 0.0
    expected[1, 4, 2] = 0.0
    np.testing.assert_allclose(weights, expected, atol=1e-9)
    np.testing.assert_array_equal(counts, (expected > 0.5).sum(axis=-1))


def test_sums_of_views():
    rng, linear, residuals, jacobians = problem(2)
    sigma, scale = rng.uniform(1.0, 2.0, residuals.shape[:3]), rng.uniform(0.5, 2.0, residuals.shape[:3])
    weights, level = rng.uniform(0.0, 1.0, sigma.shape), np.array([1.5, 0.5])
    weights[0, 7] = 0.0
    system = PathSystem(*(empty_blocks(KEYPOINTS, FRAMES, rows) for rows in (6, 3, 3, 6)))
    seen = np.empty(sigma.shape[:2], dtype=np.bool_)
    views = ViewTerms(linear, sigma, scale, level, weights.copy())
    add_views(views, system, seen)
    weights[1, 4, 2] = 0.0
    np.testing.assert_array_equal(views.weights, weights)
    np.testing.assert_array_equal(seen, weights.any(axis=-1))
    factor = weights / np.square(level[:, None, None] * sigma * scale)
    residuals, jacobians = np.nan_to_num(residuals), np.nan_to_num(jacobians)
    information = np.einsum("kfv,kfvai,kfvaj->kfij", factor, jacobians, jacobians)
    np.testing.assert_allclose(matrices_from_blocks(system.information, FRAMES), information)
    gradient = np.einsum("kfv,kfvai,kfva->kfi", factor, jacobians, residuals)
    np.testing.assert_allclose(from_blocks(system.rhs, FRAMES), -gradient, atol=1e-9 * np.abs(gradient).max())


def test_residuals_are_those_of_the_blocks():
    _, linear, residuals, _ = problem(3)
    rows = linear.reshape(KEYPOINTS, 2, VIEWS, LINEAR_ROWS, BLOCK).transpose(0, 1, 4, 2, 3)
    rows = rows.reshape(KEYPOINTS, 2 * BLOCK, VIEWS, LINEAR_ROWS)[:, :FRAMES]
    np.testing.assert_array_equal(residuals, rows[..., :2])
    rig = build_rig("ring", VIEWS, "barrel")
    points, pixels = np.zeros((KEYPOINTS, FRAMES, 3)), residuals + 500.0
    expected, jacobians = linearize(rig.packed, points, pixels)
    np.testing.assert_array_equal(residuals_px(rig.packed, points, pixels), expected)
    np.testing.assert_array_equal(np.isnan(jacobians).all(axis=(-1, -2)), np.isnan(expected[..., 0]))


def test_scaled_residuals_have_the_variance_of_errors():
    rng, _, residuals, _ = problem(4)
    sigma, agreed = rng.uniform(1.0, 2.0, residuals.shape[:3]), np.ones(residuals.shape[:3], dtype=bool)
    sigma[0, 0, 0], agreed[0, 1] = np.inf, False
    agreed[0, 2, :2] = False
    used = agreed & np.isfinite(sigma) & np.isfinite(residuals[..., 0])
    count = used.sum(axis=-1)
    used &= (count > 1)[..., None]
    retained = (np.maximum(2.0 * count - 3.0, 1.0) / np.maximum(2.0 * count, 1.0))[..., None]
    expected = np.where(used[..., None], residuals / sigma[..., None] / np.sqrt(retained)[..., None], 0.0)
    left = np.empty(sigma.shape)
    scale_residuals(sigma, agreed, residuals, left)
    np.testing.assert_allclose(residuals, expected, rtol=1e-14)
    np.testing.assert_array_equal(left, np.where(used, retained, 0.0))


def test_innovations_do_not_follow_from_the_last_observed_error_in_either_direction():
    rng = np.random.default_rng(3)
    residuals, retained = rng.normal(size=(1, 9, 2, 2)), rng.uniform(0.5, 1.0, (1, 9, 2))
    retained[0, [2, 4, 5, 6, 7], 0] = 0.0
    correlations = np.array([0.0, *rng.uniform(0.3, 0.8, 8), 0.0])
    squares = np.empty(retained.shape)
    whiten_errors(residuals, retained, correlations, 1.5, squares)
    expected = np.zeros((9, 2))
    for view in range(2):
        own = [f for f in range(9) if retained[0, f, view] > 0.0]
        for f in own:
            for others in ([g for g in own if f - 3 <= g < f][-1:], [g for g in own if f < g <= f + 3][:1]):
                c, last = 0.0, f
                for last in others:
                    c = np.prod(correlations[min(f, last) + 1 : max(f, last) + 1])
                innovation = residuals[0, f, view] - c * residuals[0, last, view]
                expected[f, view] += 0.5 * retained[0, f, view] * np.square(innovation).sum() / (1.0 - c**2) / 1.5
    np.testing.assert_allclose(squares[0], expected)
