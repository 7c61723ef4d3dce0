"""Regressions with a change point, compared with separate ones."""

import numpy as np
import pytest

from posefuse.biomechanics.contact_times import _costs


def _residual(basis: list[np.ndarray], velocity: np.ndarray) -> float:
    design = np.stack(basis, axis=1)
    return float(np.square(velocity - design @ np.linalg.lstsq(design, velocity, rcond=None)[0]).sum())


@pytest.mark.parametrize("last_s", [0.2, 0.02, -0.1])
def test_costs_equal_those_of_separate_regressions(last_s):
    rng = np.random.default_rng(0)
    time_s = np.sort(rng.uniform(-0.2, last_s, 20))
    velocity = 0.05 * rng.normal(size=(20, 3)) + 3.0 * np.clip(time_s, 0.0, None)[:, None]
    shifts = np.linspace(-0.1, 0.1, 9)
    touching, leaving = (_costs(time_s - shifts[:, None], velocity, leaving=each) for each in (False, True))
    for i, shift in enumerate(shifts):
        moving = np.clip(time_s - shift, 0.0, None)
        smooth = _residual([moving, moving**2], velocity)
        sudden = _residual([(time_s > shift).astype(float), moving, moving**2], velocity)
        assert touching[i] == pytest.approx(sudden)
        assert leaving[i] == pytest.approx(min(smooth, sudden * 60 ** (6.0 / 60)))
