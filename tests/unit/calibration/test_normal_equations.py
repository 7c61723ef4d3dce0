"""Derivatives of the projection."""

import numpy as np
import pytest

from posefuse.calibration.normal_equations import compute_rows, shared_columns
from posefuse.calibration.parameters import N_PARAMETERS, apply_changes
from posefuse.calibration.point_observations import PointObservations
from tests.scenes import LENSES, ring


@pytest.mark.parametrize("lens", list(LENSES))
def test_derivatives_match_finite_differences(lens, rng):
    rig = ring(2, lens)
    points = rng.uniform(-0.5, 1.5, (6, 3))
    n = len(points)
    observed = PointObservations(
        np.zeros(n, dtype=np.int64), np.arange(n), np.zeros((n, 2)), np.ones(n), points, np.arange(n), np.arange(n)
    )
    rows = compute_rows(rig, observed, points, np.ones(2))
    for k in range(6 if lens == "pinhole" else N_PARAMETERS):
        change = np.zeros((2, N_PARAMETERS))
        change[0, k] = 1e-6
        up, down = (
            compute_rows(apply_changes(rig, sign * change), observed, points, np.ones(2)).residual for sign in (1, -1)
        )
        assert np.allclose((up - down) / 2e-6, rows.by_camera[:, :, k], rtol=1e-4, atol=1e-2)


def test_parameters_that_views_share_have_one_column():
    free = np.array([[True, False, True, True], [True, True, True, True]])
    expected = [[1, 0, 0, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 0, 1]]
    expected += [[0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 0, 1]]
    assert shared_columns(free, 2).tolist() == expected
    assert shared_columns(free, 0).tolist() == np.eye(7).tolist()
    fixed = free & [True, True, False, False]
    assert shared_columns(fixed, 2).tolist() == np.eye(3).tolist()
