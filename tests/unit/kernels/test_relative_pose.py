"""Kernels of relative poses against naive twins."""

import numpy as np
import pytest

from posefuse.kernels.calibration.affine_agreement import affine_costs
from posefuse.kernels.calibration.relative_pose import (
    COLUMNS,
    RAY_A,
    RAY_B,
    STUDENT_T_DOF,
    VARIANCE_A,
    VARIANCE_B,
    VELOCITY,
    epipolar_costs,
    epipolar_residuals,
    refine_relative_pose,
)
from posefuse.model.cameras import rotation_from_vector


def unit(values):
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def essential(rotation, translation):
    return np.cross(np.eye(3), translation) @ rotation


def two_views(rng, n=300, noise=1e-3):
    """Return a pose (4, 3) and a table of points whose second rays were taken 0.04 s too early."""
    rotation, translation = rotation_from_vector(np.array([0.1, 0.9, -0.2])), unit(np.array([-3.0, 0.3, 1.2]))
    points = rng.uniform(-1.0, 1.0, (n, 3)) + np.array([0.0, 0.0, 5.0])
    moved = points + 0.04 * rng.normal(0.0, 1.0, (n, 3))
    table = np.empty((n, COLUMNS))
    table[:, RAY_A:RAY_B] = unit(points + noise * 5.0 * rng.standard_normal((n, 3)))
    early, late = (unit(p @ rotation.T + 3.2 * translation) for p in (points + (points - moved), points))
    table[:, RAY_B:VELOCITY] = unit(early + noise * rng.standard_normal((n, 3)))
    table[:, VELOCITY:VARIANCE_A] = (late - early) / 0.04
    table[:, VARIANCE_A], table[:, VARIANCE_B] = noise**2, (2.0 * noise) ** 2
    return np.concatenate([rotation, translation[None]]), table


def naive_residual(pose, row):
    """Return the Sampson distance by numerical differentiation along the tangents of both rays."""
    e = essential(pose[:3], pose[3])
    a, b = row[RAY_A:RAY_B], row[RAY_B:VELOCITY]
    variance = 0.0
    for gradient, ray, column in ((e.T @ b, a, VARIANCE_A), (e @ a, b, VARIANCE_B)):
        tangential = gradient - (gradient @ ray) * ray
        variance += row[column] * tangential @ tangential
    return b @ e @ a / np.sqrt(variance)


def test_residuals_and_costs_are_those_of_the_naive_twin(rng):
    pose, table = two_views(rng, 20)
    table[3, RAY_B] = np.nan
    residuals = np.empty(20)
    epipolar_residuals(pose[:3], pose[3], table, residuals)
    expected = [naive_residual(pose, row) for row in table]
    np.testing.assert_allclose(residuals, expected, rtol=1e-9)
    costs = np.empty(1)
    finite = np.delete(table, 3, axis=0)
    epipolar_costs(essential(pose[:3], pose[3])[None], finite, costs)
    assert costs[0] == pytest.approx(np.log1p(np.delete(expected, 3) ** 2 / STUDENT_T_DOF).mean())


def test_refinement_finds_pose_and_time_offset_despite_outliers(rng):
    true, table = two_views(rng, 400, 5e-4)
    table[:60, RAY_B:VELOCITY] = unit(rng.standard_normal((60, 3)))
    pose = true.copy()
    pose[:3] = rotation_from_vector(np.array([0.05, -0.1, 0.04])) @ pose[:3]
    pose[3] = unit(pose[3] + [0.1, 0.1, -0.1])
    shift_s, cost = refine_relative_pose(pose, table, 50, 0.2)
    assert np.linalg.norm(pose[:3] - true[:3]) < 0.02
    assert np.linalg.norm(pose[3] - true[3]) < 0.02
    assert shift_s == pytest.approx(0.04, abs=0.01)
    moved = table.copy()
    moved[:, RAY_B:VELOCITY] += shift_s * table[:, VELOCITY:VARIANCE_A]
    costs = np.empty(1)
    epipolar_costs(essential(pose[:3], pose[3])[None], moved, costs)
    assert costs[0] == pytest.approx(cost)


def test_bounded_time_offset(rng):
    pose, table = two_views(rng)
    shift_s, _ = refine_relative_pose(pose, table, 50, 0.01)
    assert abs(shift_s) <= 0.01


def naive_affine(at_a, variance_a, at_b, variance_b):
    """Return the cost of the smallest principal component after three reweightings."""
    z = np.concatenate([at_a, at_b], axis=1)
    weight = np.ones(len(z))
    scale = np.sqrt(np.repeat([variance_a.mean(), variance_b.mean()], 2))
    for _ in range(4):
        mean = np.average(z, axis=0, weights=weight)
        covariance = np.cov((z - mean).T, aweights=weight, ddof=0)
        axis = np.linalg.eigh(covariance / np.outer(scale, scale))[1][:, 0] / scale
        squared = ((z - mean) @ axis) ** 2 / ((axis[:2] ** 2).sum() * variance_a + (axis[2:] ** 2).sum() * variance_b)
        weight = 1.0 / (STUDENT_T_DOF + squared)
    return np.log1p(squared / STUDENT_T_DOF).mean()


def test_affine_costs_are_those_of_the_naive_twin(rng):
    n = 80
    points = rng.standard_normal((n, 3))
    at_a = points[:, :2] + 0.05 * rng.standard_normal((n, 2))
    matching = points @ rng.standard_normal((3, 2)) + 0.05 * rng.standard_normal((n, 2))
    at_b = np.stack([matching, rng.standard_normal((n, 2)), np.full((n, 2), np.nan)])
    variance_a, variance_b = rng.uniform(2e-3, 3e-3, n), rng.uniform(2e-3, 3e-3, (3, n))
    costs, counts = np.empty(3), np.empty(3, dtype=np.int64)
    affine_costs(at_a, variance_a, at_b, variance_b, costs, counts)
    # Inverse iteration converges slowly where no direction is much better than the others.
    for s, tolerance in enumerate((1e-6, 0.05)):
        assert costs[s] == pytest.approx(naive_affine(at_a, variance_a, at_b[s], variance_b[s]), rel=tolerance)
    assert costs[0] < 0.5 * costs[1]
    assert np.isnan(costs[2])
    assert counts.tolist() == [n, n, 0]
