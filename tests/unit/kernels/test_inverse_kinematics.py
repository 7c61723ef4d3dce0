"""Kernels of inverse kinematics against finite differences of a plain objective."""

import numpy as np
import pytest

from posefuse.biomechanics.body_scales import scale_basis, scale_factors
from posefuse.biomechanics.coordinate_priors import moving_prior
from posefuse.biomechanics.inverse_kinematics import solve
from posefuse.kernels.biomechanics.inverse_kinematics import CAP, parameter_equations
from tests.unit.biomechanics.bodies import gait, model_of, points_of

MODEL = model_of()
PRIOR = moving_prior().with_habits(np.zeros(12))
BASIS, _ = scale_basis(MODEL.anatomy)
PERSON = points_of(MODEL, gait(MODEL, 3), 0.008)


def objective(coordinates: np.ndarray, parameters: np.ndarray, frame: int = 1) -> float:
    """Return half of the objective of a frame, by its definition."""
    n = BASIS.shape[2]
    locations = MODEL.markers.locations_m + parameters[n:].reshape(-1, 3)
    scales = scale_factors(BASIS, parameters[:n])
    found = MODEL.anatomy.marker_positions(scales, coordinates[None], MODEL.markers.bodies, locations)[0]
    residual = found - PERSON.points_m[frame]
    square = np.einsum("ki,kij,kj->k", residual, PERSON.information[frame], residual)
    huber = np.where(square <= CAP**2, square, CAP * (2.0 * np.sqrt(square) - CAP))
    off = coordinates - PRIOR.mean
    return 0.5 * float(huber.sum() + off @ PRIOR.precision @ off)


def gradient(function, at: np.ndarray, step: float = 1e-6) -> np.ndarray:
    steps = step * np.eye(len(at))
    return np.array([(function(at + each) - function(at - each)) / (2.0 * step) for each in steps])


def test_solutions_are_minima_of_the_objective():
    solution = solve(MODEL, PERSON, PRIOR)
    none = np.zeros(BASIS.shape[2] + 3 * len(MODEL.keypoints))
    slope = gradient(lambda q: objective(q, none), solution.coordinates[1])
    scale = np.sqrt(np.diag(solution.covariance[1]))
    assert np.abs(slope * scale).max() < 1e-2
    assert solution.cost[1] == pytest.approx(2.0 * objective(solution.coordinates[1], none), rel=1e-6)


def test_parameter_equations_are_derivatives_of_the_objective():
    solution = solve(MODEL, PERSON, PRIOR)
    q = solution.coordinates[1]
    size = BASIS.shape[2] + 3 * len(MODEL.keypoints)
    out = np.zeros((size, size)), np.zeros((len(q), size)), np.zeros(size)
    frame = (PERSON.points_m[1], PERSON.information[1])
    parameter_equations(MODEL.kernel_model, BASIS, frame, q, MODEL.anatomy.new_state(), out)
    hessian, mixed, slope = out
    none = np.zeros(size)
    assert slope == pytest.approx(gradient(lambda p: objective(q, p), none), rel=1e-4, abs=0.05)

    # Gauss and Newton leave out second derivatives of the residuals, which are small here.
    def slope_at(moved: np.ndarray) -> np.ndarray:
        return gradient(lambda p: objective(moved, p), none)

    steps = 1e-4 * np.eye(len(q))[[6, 9, 20]]
    by_coordinate = np.array([(slope_at(q + step) - slope_at(q - step)) / 2e-4 for step in steps])
    assert np.abs(mixed[[6, 9, 20]] - by_coordinate).max() < 0.1 * np.abs(mixed).max()
    assert np.linalg.eigvalsh(hessian).min() > -1e-6 * np.abs(hessian).max()
