"""A standing person shared by the tests of biomechanics."""

import pytest

from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate


@pytest.fixture(scope="module")
def truth():
    return simulate(SceneOptions(duration_s=0.5, cameras=2, detector=CLEAN)).truth


@pytest.fixture
def layer(truth):
    return truth.best_layer()[1]
