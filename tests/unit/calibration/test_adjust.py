"""Bundle adjustment."""

import numpy as np

from posefuse.calibration.adjust import adjust
from posefuse.calibration.normal_equations import compute_rows
from posefuse.calibration.parameters import FreeParameters
from posefuse.calibration.point_observations import PointObservations
from tests.scenes import ring

from .conftest import moved


def test_adjustment_without_noise_is_exact(rng):
    truth = ring(3)
    points = rng.uniform([-0.7, -0.7, 0.3], [0.7, 0.7, 1.7], (80, 3))
    pixels = truth.project(points)
    view, point = np.tile([0, 1, 2], 80), np.repeat(np.arange(80), 3)
    observed = PointObservations(
        view, point, pixels[point, view], np.ones(240), points + 0.01, np.arange(80), np.zeros(80, dtype=np.int64)
    )
    start = moved(truth, "cam_1", y_rad=0.02, x_m=0.05)
    done = adjust(start, observed, FreeParameters.of(start, "extrinsics", ("cam_0",)), 20.0)
    assert np.sqrt(compute_rows(done.rig, observed, done.points_m, np.ones(3)).squared).max() < 1e-3
