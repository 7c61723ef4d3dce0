"""Principal axes of symmetric 3x3 matrices, compared with NumPy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posefuse.kernels.linear_algebra.principal_axes import diagonalize
from tests.kernels import from_python

pytestmark = pytest.mark.no_jit
diagonalized = from_python(diagonalize)


def check(matrix):
    diagonal, axes = np.array(matrix), np.full((3, 3), 9.0)
    diagonalized(diagonal, axes)
    scale = np.abs(matrix).max()
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-14)
    values = np.diag(diagonal)
    np.testing.assert_allclose(axes * values @ axes.T, matrix, atol=1e-14 * scale)
    np.testing.assert_allclose(np.sort(values), np.linalg.eigvalsh(matrix), atol=1e-14 * scale)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.tuples(*[st.floats(-12.0, 4.0)] * 3))
def test_axes_and_values_give_the_matrix(seed, exponents):
    axes, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    matrix = axes * 10.0 ** np.array(exponents) @ axes.T
    check(0.5 * (matrix + matrix.T))


@pytest.mark.parametrize(
    "matrix",
    [
        np.zeros((3, 3)),
        np.eye(3),
        np.ones((3, 3)),
        np.diag([1.0, 1e-12, 1e4]),
        np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 2.0]]),
        np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, -3.0]]),
    ],
)
def test_repeated_vanishing_and_negative_values(matrix):
    check(matrix)
