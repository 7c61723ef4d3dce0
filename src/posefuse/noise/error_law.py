"""The law of a detector's errors, by leaving views out: how they fall with confidence, and how heavy their tails are.

Each observation is compared with the point that the other views of it make. It errs by a bivariate Student t; where
the others expect it is as uncertain as they are, by a normal law, since it rests on several. Exponent, scale and
degrees of freedom are those of maximum likelihood. See docs/methods.md, "Calibrating the noise".
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.stats import gamma

from posefuse.noise.leave_one_out import Told

_MOST_EXPONENT = 4.0
_LEAST_NU, _MOST_NU = 1.0, 100.0
_NODES = 16
_FEWEST_OTHERS = 2
# A view on which alone some direction of the point rests has nothing to be compared with.
_MOST_EXPECTED = 20.0
_FEWEST_OBSERVATIONS = 200


@dataclass(frozen=True)
class NoiseLaw:
    """The law of errors.

    Attributes:
        exponent: errors fall with confidence to this power.
        scale: of the Student t, in units of the noise assumed, at a confidence of 1.
        nu: degrees of freedom of the Student t; 100 is as good as normal.
        n_observations: how many were compared.
    """

    exponent: float
    scale: float
    nu: float
    n_observations: int


def fit_law(told: Told, exponent: float) -> NoiseLaw | None:
    """The maximum-likelihood law of the observations of some points, or None where too few tell.

    Args:
        told: the points.
        exponent: of the confidence that ``told.sigma_px`` was assumed with.
    """
    flat = told.sigma_px * told.confidence**exponent
    compared = _compare(told, flat, exponent)
    if len(compared.along) < _FEWEST_OBSERVATIONS:
        return None

    def cost(parameters: np.ndarray) -> float:
        tried = float(np.clip(parameters[0], 0.0, _MOST_EXPONENT))
        likelihood = _log_likelihood(_compare(told, flat, tried), math.exp(parameters[1]), _nu(parameters))
        # Ever so weakly drawn to an even law, so that there is one maximum where the data have none.
        return -likelihood + 1e-5 * float(parameters[2] ** 2)

    start = np.array([[exponent, 0.0, 2.0], [exponent + 0.5, 0.0, 2.0], [exponent, 0.3, 2.0], [exponent, 0.0, 1.2]])
    found = minimize(
        cost, start[0], method="Nelder-Mead", options={"initial_simplex": start, "xatol": 5e-3, "fatol": 1e-6}
    ).x
    return NoiseLaw(float(np.clip(found[0], 0.0, _MOST_EXPONENT)), math.exp(found[1]), _nu(found), len(compared.along))


def _nu(parameters: np.ndarray) -> float:
    return min(max(math.exp(parameters[2]), _LEAST_NU), _MOST_NU)


@dataclass(frozen=True)
class _Compared:
    """Observations beside what the other views expect, in units of the noise assumed.

    Attributes:
        along: shape (observation, 2): squared differences along the two axes of the expectation's uncertainty.
        expected: shape (observation, 2): its variance along them.
        log_sigma: shape (observation,): logarithm of the noise assumed.
    """

    along: np.ndarray
    expected: np.ndarray
    log_sigma: np.ndarray


def _compare(told: Told, flat_px: np.ndarray, exponent: float) -> _Compared:
    with np.errstate(divide="ignore"):
        sigma = flat_px / told.confidence**exponent
    fit = told.points.fit(sigma, told.used)
    left_out, inverse = fit.leave_one_out()
    others = fit.used.sum(axis=1, keepdims=True) - fit.used
    tells = np.isfinite(sigma) & np.isfinite(told.points.residuals_px[..., 0]) & (others >= _FEWEST_OTHERS)
    kept, axes = np.linalg.eigh(inverse[tells])
    difference = (np.swapaxes(axes, -1, -2) @ left_out[tells][..., None])[..., 0]
    expected = np.maximum(1.0 / np.maximum(kept, 1e-9) - 1.0, 0.0) * fit.squared.sum() / fit.degrees_of_freedom.sum()
    known = expected.max(axis=-1, initial=0.0) < _MOST_EXPECTED
    return _Compared(np.square(difference)[known], expected[known], np.log(sigma[tells][known]))


def _log_likelihood(compared: _Compared, scale: float, nu: float) -> float:
    """The mean over observations; the Student t is a mixture of normal laws over the gamma law of their precision."""
    # Gauss and Legendre's rule in the cube root of probability: far tails are rare and imprecise.
    place, weight = np.polynomial.legendre.leggauss(_NODES)
    place, weight = 0.5 * (place + 1.0), 0.5 * weight
    precision = gamma.ppf(place**3, 0.5 * nu, scale=2.0 / nu)
    logs = np.empty((_NODES, len(compared.along)))
    for node, (w, share) in enumerate(zip(precision, 3.0 * place**2 * weight, strict=True)):
        variance = scale**2 / w + compared.expected
        logs[node] = math.log(share) - 0.5 * (compared.along / variance + np.log(variance)).sum(axis=-1)
    top = logs.max(axis=0)
    mixed = top + np.log(np.exp(logs - top).sum(axis=0))
    return float((mixed - 2.0 * compared.log_sigma).mean()) - math.log(2.0 * math.pi)
