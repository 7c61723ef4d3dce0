"""Sizes of a person's bodies and locations of keypoints on them: most probable values and their covariance.

The coordinates of every sampled frame are eliminated from the joint problem (variable projection, Golub and Pereyra
2003, Inverse Problems 19): only the constant parameters remain.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.biomechanics.body_scales import scale_basis, scale_factors
from posefuse.biomechanics.coordinate_priors import CoordinatePrior, moving_prior, upright_prior
from posefuse.biomechanics.inverse_kinematics import PersonPoints, Solution, solve
from posefuse.biomechanics.marker_model import MarkerModel
from posefuse.kernels.biomechanics.curvature import bend_equations
from posefuse.kernels.biomechanics.inverse_kinematics import Prior, parameter_equations

_MOST_STEPS = 12
_TOLERANCE = 2e-4
_LONGEST_STEP = 0.3
"""Largest change of a parameter per step. Steps toward a body of a different order of size would overflow."""
_SIDE_CORRELATION = 0.7
"""Correlation of the deviations of a left keypoint and its mirror image."""
_MIRROR = np.array([1.0, 1.0, -1.0])


@dataclass(frozen=True, eq=False)
class SubjectFit:
    """A person's constant parameters.

    Attributes:
        model: the model with this person's scales and locations.
        habits: shape (habit,): deviations of the coordinates' means from those of other people, rad.
        factor: shape (parameter, parameter): ``factor @ factor.T`` is the covariance of the parameters.
    """

    model: MarkerModel
    habits: np.ndarray
    factor: np.ndarray

    @property
    def prior(self) -> Prior:
        """Prior of this person's coordinates."""
        return moving_prior().with_habits(self.habits)


@dataclass(frozen=True, eq=False)
class Sample:
    """Frames from which a person is estimated.

    Attributes:
        points: the points of these frames.
        weight: information of each frame relative to an independent one, from 0 to 1.
        prior: prior of the coordinates.
    """

    points: PersonPoints
    weight: float
    prior: CoordinatePrior


def moving_sample(points: PersonPoints, weight: float) -> Sample:
    """Return a sample of any motion."""
    return Sample(points, weight, moving_prior())


def upright_sample(points: PersonPoints, is_static: bool) -> Sample:
    """Return a sample of one posture: upright standing. A static trial has half of the standard deviations."""
    return Sample(points, 1.0 / max(len(points.usable), 1), upright_prior(0.5 if is_static else 1.0))


def fit_subject(model: MarkerModel, samples: tuple[Sample, ...]) -> SubjectFit:
    """Estimate a person's scales, locations and habits.

    Args:
        model: the unscaled model.
        samples: frames; without usable ones, the estimate is the prior.
    """
    basis, scale_sd = scale_basis(model.anatomy)
    precision = _prior_precision(model, scale_sd, moving_prior().habit_sd)
    parameters = np.zeros(len(precision))
    fit, hessian = _with(model, basis, parameters), precision
    for _ in range(_MOST_STEPS):
        hessian, gradient = precision.copy(), precision @ parameters
        for sample in samples:
            _add_sample(fit, basis, sample, hessian, gradient)
        step = np.linalg.solve(hessian, -gradient)
        step *= _LONGEST_STEP / max(np.abs(step).max(), _LONGEST_STEP)
        parameters = parameters + step
        fit = _with(model, basis, parameters)
        if np.abs(step).max() < _TOLERANCE:
            break
    return replace(fit, factor=_inverse_factor(hessian))


def _inverse_factor(hessian: np.ndarray) -> np.ndarray:
    """Return a factor of the inverse; rounding leaves no positive eigenvalue of some directions without bounds."""
    values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
    return vectors / np.sqrt(np.maximum(values, 1e-14 * values[-1]))


def systematic_covariance(fit: SubjectFit, person: PersonPoints, solution: Solution) -> np.ndarray:
    """Return the covariance of coordinates due to a person's parameters, shape (frame, coordinate, coordinate).

    Args:
        fit: the person's parameters.
        person: points of some frames.
        solution: the coordinates of these frames.
    """
    basis, _ = scale_basis(fit.model.anatomy)
    out = np.full_like(solution.covariance, np.nan)
    for t in np.flatnonzero(np.isfinite(solution.cost)):
        _, mixed, _ = _frame_equations(fit, basis, Sample(person, 1.0, moving_prior()), solution.coordinates[t], int(t))
        change = solution.covariance[t] @ (mixed @ fit.factor)
        out[t] = change @ change.T
    return out


def _with(model: MarkerModel, basis: np.ndarray, parameters: np.ndarray) -> SubjectFit:
    """Return the fit with these parameters, without their covariance."""
    n, stop = basis.shape[2], basis.shape[2] + 3 * len(model.keypoints)
    locations = model.markers.locations_m + parameters[n:stop].reshape(-1, 3)
    fitted = model.with_parameters(scale_factors(basis, parameters[:n]), locations)
    return SubjectFit(fitted, parameters[stop:], np.empty((0, 0)))


def _prior_precision(model: MarkerModel, scale_sd: np.ndarray, habit_sd: np.ndarray) -> np.ndarray:
    """Return the precision of the parameters' prior, in which left and right deviations are correlated."""
    n = len(scale_sd)
    covariance = np.diag(np.concatenate([scale_sd, model.sd_m.ravel(), habit_sd]) ** 2)
    for k, twin in enumerate(model.twins):
        if twin != k:
            for a in range(3):
                shared = _SIDE_CORRELATION * _MIRROR[a] * model.sd_m[k, a] ** 2
                covariance[n + 3 * k + a, n + 3 * twin + a] = shared
    return np.linalg.inv(covariance)


def _add_sample(fit: SubjectFit, basis: np.ndarray, sample: Sample, hessian: np.ndarray, gradient: np.ndarray) -> None:
    """Add the reduced equations of a sample."""
    habits = fit.habits if len(sample.prior.rows) else np.empty(0)
    solution = solve(fit.model, sample.points, sample.prior.with_habits(habits))
    for t in np.flatnonzero(np.isfinite(solution.cost)):
        own, mixed, slope = _frame_equations(fit, basis, sample, solution.coordinates[t], int(t))
        hessian += sample.weight * (own - mixed.T @ solution.covariance[t] @ mixed)
        gradient += sample.weight * (slope - _mean_gradient(fit, basis, sample, solution, mixed, int(t)))


def _mean_gradient(
    fit: SubjectFit, basis: np.ndarray, sample: Sample, solution: Solution, mixed: np.ndarray, t: int
) -> np.ndarray:
    """Return the mean of a frame's reduced gradient at the true parameters.

    It is not zero, because noisy markers move on arcs. The solution of the equations without it is biased (McCullagh
    and Tibshirani 1990, J R Stat Soc B 52(2)).
    """
    model, coordinates, covariance = fit.model, solution.coordinates[t], solution.covariance[t]
    frame = (sample.points.points_m[t], sample.points.information[t])
    by_coordinate, by_parameter = np.zeros(len(coordinates)), np.zeros(mixed.shape[1])
    out = (by_coordinate, by_parameter)
    bend_equations(model.kernel_model, basis, frame, coordinates, covariance, model.anatomy.new_state(), out)
    return by_parameter - mixed.T @ (covariance @ by_coordinate)


def _frame_equations(
    fit: SubjectFit, basis: np.ndarray, sample: Sample, coordinates: np.ndarray, t: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the Hessian, mixed derivatives and gradient of a frame."""
    model = fit.model
    n, size = len(coordinates), basis.shape[2] + 3 * len(model.keypoints) + len(fit.habits)
    out = np.zeros((size, size)), np.zeros((n, size)), np.zeros(size)
    frame = (sample.points.points_m[t], sample.points.information[t])
    parameter_equations(model.kernel_model, basis, frame, coordinates, model.anatomy.new_state(), out)
    sample.prior.add_equations(coordinates, fit.habits, out)
    return out
