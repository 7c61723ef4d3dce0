"""Cost of the pose of one camera, its gradient, and descent."""

from dataclasses import replace

import numpy as np

from posefuse.calibration.boards.parameters import N_PARAMETERS, changed
from posefuse.calibration.scene.view import KnownLens, descend, errors_px, view_of, weighted_normal
from tests.boards import board_rig
from tests.unit.calibration.scene.test_calibration import SOLID


def test_gradient_is_that_of_the_cost():
    camera = board_rig(1).cameras[0]
    lens = KnownLens(camera, np.diag([20.0, 20.0, 10.0, 10.0, 0.01, 0.01, *[0.0] * 6]) ** 2)
    pixels = camera.project(SOLID)[0] + np.random.default_rng(0).normal(0.0, 3.0, (len(SOLID), 2))
    view = view_of(lens, SOLID, pixels)
    gradient = weighted_normal(view, 2.0)[1]
    free = np.flatnonzero(view.free)
    assert len(free) == 12
    for k, at in enumerate(free[:10]):
        step = np.zeros(N_PARAMETERS)
        step[at] = 1e-4 if at >= 6 else 1e-6
        ahead, behind = (replace(view, camera=changed(camera, sign * step)).cost(2.0) for sign in (1.0, -1.0))
        assert np.isclose((ahead - behind) / (2 * step[at]), gradient[k], rtol=1e-3, atol=1e-3 * np.abs(gradient[k]))


def test_descent_finds_the_pose():
    camera = board_rig(1).cameras[0]
    step = np.zeros(N_PARAMETERS)
    step[:6] = 0.02
    view = view_of(KnownLens(camera), SOLID, camera.project(SOLID)[0])
    moved = replace(view, camera=changed(camera, step))
    assert errors_px(moved).max() > 5.0
    assert errors_px(descend(moved, 1.0)).max() < 1e-6
