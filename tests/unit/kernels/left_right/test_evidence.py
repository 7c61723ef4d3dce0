"""Likelihoods of labels, compared with NumPy."""

import numpy as np
import pytest

from posefuse.kernels.left_right.evidence import LabeledRows, add_label_likelihoods
from posefuse.model.reconstruction import unpack_covariance

pytestmark = pytest.mark.no_jit
POINTS, VIEWS, DOF = 60, 4, 3.0


def inverse(matrices: np.ndarray) -> np.ndarray:
    """Return inverses of 2x2 matrices whose determinants are large enough."""
    return np.linalg.inv(matrices)


def expected(rows, rests_on, covariance) -> np.ndarray:
    """Return twice the log-likelihoods, shape (2, point, view)."""
    spread = rows[0].jacobians @ covariance[:, None] @ rows[0].jacobians.swapaxes(-1, -2)
    other = rows[1].jacobians @ covariance[:, None] @ rows[1].jacobians.swapaxes(-1, -2)
    spread = np.where(np.isnan(spread), other, spread)
    out = np.zeros((2, POINTS, VIEWS))
    for p, v in np.ndindex(POINTS, VIEWS):
        which, one = rests_on[p, v], spread[p, v]
        if np.isnan(one).any():
            continue
        if which < 0:
            shift, variance = np.zeros(2), one + np.eye(2) * rows[0].sigma[p, v] ** 2
        else:
            sigma2 = rows[which].sigma[p, v] ** 2
            share = one / sigma2
            share = share * min(1.0, 0.99 / np.linalg.eigvalsh(share)[-1])
            gain = inverse(np.eye(2) - share)
            shift, variance = (gain - np.eye(2)) @ rows[which].residuals[p, v], gain * sigma2
        for label in range(2):
            residual = rows[label].residuals[p, v] + shift
            cost = -(DOF + 2.0) * np.log1p(residual @ inverse(variance) @ residual / DOF)
            out[label, p, v] = np.nan_to_num(cost)
    return out


def test_likelihoods_of_both_labels(rng):
    rows = tuple(
        LabeledRows(
            rng.normal(scale=4.0, size=(POINTS, VIEWS, 2)), rng.normal(scale=500.0, size=(POINTS, VIEWS, 2, 3)),
            rng.uniform(1.0, 3.0, (POINTS, VIEWS)),
        )
        for _ in range(2)
    )  # fmt: skip
    for label, view in ((0, 1), (1, 2)):
        rows[label].residuals[:9, view] = np.nan
        rows[label].jacobians[:9, view] = np.nan
    covariance = rng.normal(scale=0.002, size=(POINTS, 3, 3))
    covariance = covariance @ covariance.swapaxes(-1, -2)
    packed = covariance[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_array_equal(unpack_covariance(packed), unpack_covariance(packed).swapaxes(-1, -2))
    rests_on = rng.integers(-1, 2, (POINTS, VIEWS))
    total = np.ones((2, POINTS, VIEWS))
    add_label_likelihoods(rows, rests_on, packed, DOF, total)
    np.testing.assert_allclose(total - 1.0, expected(rows, rests_on, covariance), rtol=1e-6, atol=1e-6)
