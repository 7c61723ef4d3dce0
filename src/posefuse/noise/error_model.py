"""Fit the error model of a detector by leaving views out: confidence exponent, scale and tails.

Each observation is compared with the point that the other views determine. Its error follows a bivariate Student t
distribution; the uncertainty of the other views' point is Gaussian, since it combines several observations. Exponent,
scale and degrees of freedom are maximum-likelihood estimates. See docs/methods/noise.md.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import gammaincinv

from posefuse.noise.leave_one_out import LeaveOneOutPoints

_MAX_EXPONENT = 4.0
_MIN_NU, _MAX_NU = 1.0, 100.0
_NODES = 16
_MIN_OTHER_VIEWS = 2
# An observation that alone determines a direction of the point cannot be compared with the other views.
_MAX_PREDICTED_VARIANCE = 20.0
_MIN_OBSERVATIONS = 200


@dataclass(frozen=True)
class ErrorModel:
    """A detector's error model.

    Attributes:
        exponent: errors decrease with confidence to this power.
        scale: scale of the Student t distribution at a confidence of 1, in units of the assumed noise.
        nu: degrees of freedom of the Student t distribution; 100 is practically Gaussian.
        n_observations: number of observations compared.
    """

    exponent: float
    scale: float
    nu: float
    n_observations: int


def fit_error_model(points: LeaveOneOutPoints, exponent: float) -> ErrorModel | None:
    """Fit the maximum-likelihood error model; None with too few observations.

    Args:
        points: points with redundant views.
        exponent: the confidence exponent that ``points.sigma_px`` was computed with.
    """
    flat = points.sigma_px * points.confidence**exponent
    compared = _compare(points, flat, exponent)
    if len(compared.along) < _MIN_OBSERVATIONS:
        return None

    def cost(parameters: np.ndarray) -> float:
        tried = float(np.clip(parameters[0], 0.0, _MAX_EXPONENT))
        likelihood = _log_likelihood(_compare(points, flat, tried), math.exp(parameters[1]), _nu(parameters))
        # A weak prior on nu gives a unique maximum where the data have none.
        return -likelihood + 1e-5 * float(parameters[2] ** 2)

    start = np.array([[exponent, 0.0, 2.0], [exponent + 0.5, 0.0, 2.0], [exponent, 0.3, 2.0], [exponent, 0.0, 1.2]])
    found = minimize(
        cost, start[0], method="Nelder-Mead", options={"initial_simplex": start, "xatol": 5e-3, "fatol": 1e-6}
    ).x
    return ErrorModel(float(np.clip(found[0], 0.0, _MAX_EXPONENT)), math.exp(found[1]), _nu(found), len(compared.along))


def _nu(parameters: np.ndarray) -> float:
    return min(max(math.exp(parameters[2]), _MIN_NU), _MAX_NU)


@dataclass(frozen=True)
class _Compared:
    """Observations compared with the other views' predictions, in units of the assumed noise.

    Attributes:
        along: shape (observation, 2): squared differences along the principal axes of the prediction's covariance.
        expected: shape (observation, 2): variance of the prediction along these axes.
        log_sigma: shape (observation,): logarithm of the assumed noise.
    """

    along: np.ndarray
    expected: np.ndarray
    log_sigma: np.ndarray


def _compare(points: LeaveOneOutPoints, flat_px: np.ndarray, exponent: float) -> _Compared:
    with np.errstate(divide="ignore"):
        sigma = flat_px / points.confidence**exponent
    fit = points.points.fit(sigma, points.used)
    left_out, inverse = fit.leave_one_out()
    others = fit.used.sum(axis=1, keepdims=True) - fit.used
    comparable = np.isfinite(sigma) & np.isfinite(points.points.residuals_px[..., 0]) & (others >= _MIN_OTHER_VIEWS)
    share, axes = np.linalg.eigh(inverse[comparable])
    difference = (np.swapaxes(axes, -1, -2) @ left_out[comparable][..., None])[..., 0]
    expected = np.maximum(1.0 / np.maximum(share, 1e-9) - 1.0, 0.0) * fit.squared.sum() / fit.degrees_of_freedom.sum()
    valid = expected.max(axis=-1, initial=0.0) < _MAX_PREDICTED_VARIANCE
    return _Compared(np.square(difference)[valid], expected[valid], np.log(sigma[comparable][valid]))


def _log_likelihood(compared: _Compared, scale: float, nu: float) -> float:
    """Return the mean log-likelihood, with the Student t as a mixture of Gaussians with gamma-distributed precision."""
    # Gauss-Legendre quadrature in the cube root of probability resolves the tails.
    place, weight = np.polynomial.legendre.leggauss(_NODES)
    place, weight = 0.5 * (place + 1.0), 0.5 * weight
    precision = gammaincinv(0.5 * nu, place**3) * (2.0 / nu)
    logs = np.empty((_NODES, len(compared.along)))
    for node, (w, share) in enumerate(zip(precision, 3.0 * place**2 * weight, strict=True)):
        variance = scale**2 / w + compared.expected
        logs[node] = math.log(share) - 0.5 * (compared.along / variance + np.log(variance)).sum(axis=-1)
    top = logs.max(axis=0)
    mixed = top + np.log(np.exp(logs - top).sum(axis=0))
    return float((mixed - 2.0 * compared.log_sigma).mean()) - math.log(2.0 * math.pi)
