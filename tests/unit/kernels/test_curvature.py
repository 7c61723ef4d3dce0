"""Corrections for curvature against finite differences, and against the means of noisy frames."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.biomechanics.body_scales import scale_basis, scale_factors
from posefuse.biomechanics.coordinate_priors import moving_prior
from posefuse.biomechanics.inverse_kinematics import posterior_means, solve
from posefuse.kernels.biomechanics.curvature import bend_equations
from tests.unit.biomechanics.bodies import gait, model_of, points_of

MODEL = model_of()
MARKERS = MODEL.markers
PRIOR = moving_prior().with_habits(np.zeros(12))
BASIS, _ = scale_basis(MODEL.anatomy)
N_SCALES = BASIS.shape[2]
PERSON = points_of(MODEL, gait(MODEL, 3), 0.008)


def positions(coordinates: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    locations = MARKERS.locations_m + parameters[N_SCALES:].reshape(-1, 3)
    scales = scale_factors(BASIS, parameters[:N_SCALES])
    return MODEL.anatomy.marker_positions(scales, coordinates[None], MARKERS.bodies, locations)[0]


@pytest.mark.no_jit
def test_the_mean_gradient_is_that_of_second_derivatives():
    solution = solve(MODEL, PERSON, PRIOR)
    q, covariance, none = solution.coordinates[1], solution.covariance[1], np.zeros(N_SCALES + 3 * len(MARKERS.bodies))
    # Half of the mean second-order displacement, from steps along a square root of the covariance.
    bend = np.zeros((len(MARKERS.bodies), 3))
    for step in 0.01 * np.linalg.cholesky(covariance).T:
        bend += 0.5e4 * (positions(q + step, none) + positions(q - step, none) - 2.0 * positions(q, none))
    pull = np.einsum("kij,kj->ki", PERSON.information[1], bend)

    def mean_gradient(at, size, of):
        steps = 1e-5 * np.eye(size)
        change = np.array([(of(at + each) - of(at - each)) / 2e-5 for each in steps])
        return np.einsum("pki,ki->p", change, pull)

    out = np.zeros(len(q)), np.zeros(len(none))
    frame = (PERSON.points_m[1], PERSON.information[1])
    bend_equations(MODEL.kernel_model, BASIS, frame, q, covariance, MODEL.anatomy.new_state(), out)
    # The splines of the knee are taken as straight.
    by_coordinate = mean_gradient(q, len(q), lambda x: positions(x, none))
    assert np.linalg.norm(out[0] - by_coordinate) < 0.03 * np.linalg.norm(by_coordinate)
    by_parameter = mean_gradient(none, len(none), lambda p: positions(q, p))
    assert np.linalg.norm(out[1] - by_parameter) < 0.03 * np.linalg.norm(by_parameter)


def test_means_are_those_of_samples_of_the_posterior():
    solution = solve(MODEL, PERSON, PRIOR)
    moved = posterior_means(MODEL, PERSON, solution)
    rng = np.random.default_rng(0)
    q, covariance = solution.coordinates[1], solution.covariance[1]
    half = np.linalg.cholesky(covariance) @ rng.standard_normal((len(q), 30_000))
    samples = q + np.concatenate([half, -half], axis=1).T
    found = MODEL.anatomy.marker_positions(MODEL.scales, samples, MARKERS.bodies, MARKERS.locations_m)
    residual = found - PERSON.points_m[1]
    square = np.einsum("ski,kij,skj->s", residual, PERSON.information[1], residual)
    off, from_mode = samples - PRIOR.mean, samples - q
    square += np.einsum("si,ij,sj->s", off, PRIOR.precision, off)
    # Importance weights correct the Gaussian at the mode; their logarithms are odd to third order.
    logs = -0.5 * square + 0.5 * np.einsum("si,ij,sj->s", from_mode, np.linalg.inv(covariance), from_mode)
    odd = 0.5 * (logs[:30_000] - logs[30_000:])
    shift = (half * odd).mean(axis=1)
    sd = np.sqrt(np.diag(covariance))
    assert (moved.coordinates[1] - q) / sd == pytest.approx(shift / sd, abs=0.1)
    assert np.corrcoef(moved.coordinates[1] - q, shift)[0, 1] > 0.9


@pytest.mark.no_jit
def test_frames_without_a_solution_stay_missing():
    person = replace(PERSON, usable=np.array([True, False, True]))
    moved = posterior_means(MODEL, person, solve(MODEL, person, PRIOR))
    assert np.isnan(moved.coordinates[1]).all()
    assert np.isfinite(moved.coordinates[[0, 2]]).all()
