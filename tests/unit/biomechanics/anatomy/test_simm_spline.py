"""Splines interpolate their values smoothly and are exact for cubics."""

import numpy as np
from scipy.interpolate import PPoly

from posefuse.biomechanics.anatomy.simm_spline import simm_spline

X = np.array([0.0, 0.2, 0.3, 0.55, 0.8, 1.1, 1.15])


def test_a_cubic_is_reproduced_exactly() -> None:
    cubic = np.polynomial.Polynomial([0.3, -1.0, 2.0, 0.7])
    pieces = simm_spline(X, cubic(X))
    x = np.linspace(X[0], X[-1], 50)
    np.testing.assert_allclose(PPoly(pieces[:-1, ::-1].T, X)(x), cubic(x), atol=1e-12)
    np.testing.assert_allclose(pieces[-1, :2], [cubic(X[-1]), cubic.deriv()(X[-1])], atol=1e-12)
    assert not pieces[-1, 2:].any()


def test_pieces_meet_with_two_derivatives() -> None:
    spline = PPoly(simm_spline(X, np.random.default_rng(1).normal(size=len(X)))[:-1, ::-1].T, X)
    for order in range(3):
        below, above = (spline(X[1:-1] + side * 1e-9, nu=order) for side in (-1, 1))
        np.testing.assert_allclose(below, above, atol=1e-5)
