"""A result in another world than the truth is recognized, an inaccurate one is not."""

import numpy as np
import pytest

from posefuse.evaluation.other_world import find_other_world, is_scaled
from posefuse.model.cameras import rotation_from_vector


@pytest.fixture
def truth(rng) -> np.ndarray:
    return rng.normal(size=(200, 3))


@pytest.mark.parametrize("scale", [1.0, 1000.0, 0.01])
def test_a_similarity_is_found(truth, rng, scale):
    turned = truth @ rotation_from_vector(np.array([0.3, -1.2, 2.0])).T + [3.0, -1.0, 0.5]
    found = find_other_world(turned / scale, truth + 0.005 * rng.normal(size=truth.shape))
    assert found is not None
    assert found.scale == pytest.approx(scale, rel=1e-2)
    assert found.mean_mm == pytest.approx(5 * np.sqrt(8 / np.pi), rel=0.15)
    assert is_scaled(found) == (scale != 1.0)


def test_errors_that_no_similarity_removes(truth, rng):
    assert find_other_world(truth, truth) is None
    assert find_other_world(truth + 0.02 * rng.normal(size=truth.shape), truth) is None
    assert find_other_world(truth + 0.05, truth + 0.02 * rng.normal(size=truth.shape)) is None
    assert find_other_world(rng.normal(size=truth.shape), truth) is None
    assert find_other_world(-truth, truth) is None
    assert find_other_world(truth[:5] + 1.0, truth[:5]) is None
