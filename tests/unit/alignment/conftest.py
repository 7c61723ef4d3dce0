"""A walking person and its true points, shared by the tests of alignment."""

import numpy as np
import pytest

from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate


@pytest.fixture(scope="module")
def walker():
    """Simulate a person who walks for 6 s on a floor at z = 0."""
    return simulate(SceneOptions(duration_s=6, cameras=4, detector=CLEAN))


@pytest.fixture(scope="module")
def true_points(walker):
    return np.asarray(walker.truth.layers["model" if "model" in walker.truth.layers else "measured"].points_m)


def rotate_points(points: np.ndarray, rotation: np.ndarray, shift: np.ndarray) -> np.ndarray:
    return points @ rotation.T + shift
