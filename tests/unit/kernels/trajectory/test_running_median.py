"""Running medians, compared with those of SciPy."""

import numpy as np
import pytest
from scipy.ndimage import median_filter

from posefuse.kernels.trajectory.running_median import running_median

pytestmark = pytest.mark.no_jit


@pytest.mark.parametrize(("frames", "window"), [(1, 5), (2, 5), (3, 7), (12, 5), (30, 13)])
def test_medians_are_those_of_the_mirrored_paths(frames, window):
    paths = np.random.default_rng(frames).normal(size=(2, frames, 3))
    # Equal values must not be mistaken for each other.
    paths[1] = np.round(paths[1])
    out = np.empty(paths.shape)
    running_median(paths, window, out)
    np.testing.assert_array_equal(out, median_filter(paths, size=(1, window, 1), mode="mirror"))
