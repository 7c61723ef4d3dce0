"""All images share one shape of the board, which is estimated in the same equations as the cameras."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.adjust import descend
from posefuse.calibration.boards.calibration import calibrate_board
from posefuse.calibration.boards.parameters import N_PARAMETERS
from posefuse.calibration.boards.shape import N_SHAPE, shape_precision
from posefuse.calibration.boards.shaped_model import ShapedModel, with_free_shape
from tests.boards import BOARD, SIZE_PX, board_detections, board_rig, unplaced

BENT = np.array([3e-4, -2e-4, 1e-4, 5e-4, -5e-4])


@pytest.fixture(scope="module")
def solution():
    rig = board_rig()
    sizes = dict.fromkeys(rig.names, SIZE_PX)
    return calibrate_board(board_detections(rig), BOARD, sizes, intrinsics=unplaced(rig)).solution


def test_derivatives_by_the_shape_match_finite_differences(solution):
    model, scale = ShapedModel(replace(solution.model, shape=BENT)), solution.scale
    rows, still = model.rows(scale), np.zeros((len(solution.model.rotations), 6))
    for k in range(N_PARAMETERS, N_PARAMETERS + N_SHAPE):
        change = np.zeros((model.n_views, N_PARAMETERS + N_SHAPE))
        change[:, k] = 1e-6
        up, down = (model.moved(sign * change, still).rows(scale) for sign in (1, -1))
        expected = (up.residual - down.residual) / 2e-6
        assert rows.by_camera[:, :, k] == pytest.approx(expected, rel=1e-4, abs=2e-2)


def test_prior_of_the_shape_counts_once(solution):
    model = ShapedModel(replace(solution.model, shape=BENT))
    wide, narrow = model.rows(solution.scale), model.board.rows(solution.scale)
    assert wide.cost - narrow.cost == pytest.approx(0.5 * float(shape_precision(BOARD) @ BENT**2), rel=1e-6)
    assert wide.prior is not None
    assert wide.prior.gradient[:, N_PARAMETERS:].sum(axis=0) == pytest.approx(shape_precision(BOARD) * BENT)
    assert wide.prior.matrices[:, N_PARAMETERS:, N_PARAMETERS:].sum(axis=0) == pytest.approx(
        np.diag(shape_precision(BOARD))
    )


def test_shape_is_at_its_optimum(solution):
    """Further steps, also those from another shape, lead to the same one; the poses follow."""
    free = with_free_shape(solution.free)
    for start in (solution.model.shape, BENT):
        model = ShapedModel(replace(solution.model, shape=start))
        found = descend(model, free, solution.scale, 1e-3, 1e-9)[0].board
        away = (found.shape - solution.model.shape) * np.sqrt(shape_precision(BOARD))
        assert np.abs(away).max() < 0.02
        assert found.errors_px().max() < 1.5 * solution.model.errors_px().max()
