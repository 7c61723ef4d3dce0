"""Inverses of symmetric matrices, compared with NumPy."""

import numpy as np
import pytest

from posefuse.kernels.linear_algebra.symmetric import invert
from tests.kernels import from_python

pytestmark = pytest.mark.no_jit
inverted = from_python(invert)


@pytest.mark.parametrize("n", [1, 2, 3, 6, 7])
def test_inverse_follows_from_the_lower_triangle(n, rng):
    root = rng.normal(size=(n, n + 2))
    expected = np.linalg.inv(root @ root.T)
    matrix = np.full((n + 1, n + 1), 9.0)
    matrix[:n, :n] = np.tril(root @ root.T)
    assert inverted(matrix, n, np.empty(2 * n))
    np.testing.assert_allclose(matrix[:n, :n], expected, rtol=1e-9)
    np.testing.assert_array_equal(matrix[n], 9.0)


@pytest.mark.parametrize("pivot", range(3))
def test_indefinite_matrix_is_not_inverted(pivot):
    matrix = np.eye(3)
    matrix[pivot, pivot] = -1.0
    assert not inverted(matrix, 3, np.empty(6))
