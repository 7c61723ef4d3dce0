"""Running medians equal SciPy's."""

import numpy as np
import pytest
from scipy.ndimage import median_filter

from posefuse.kernels.trajectory.running_median import running_median


@pytest.mark.no_jit
@pytest.mark.parametrize("frames", [1, 2, 3, 5, 30])
@pytest.mark.parametrize("window", [5, 7, 13])
def test_medians_equal_those_of_scipy(frames, window):
    # Rounded, so that equal values occur.
    values = np.round(np.random.default_rng(frames).normal(size=(2, frames, 3)), 1)
    medians = np.empty_like(values)
    running_median(values, window, medians)
    np.testing.assert_array_equal(medians, median_filter(values, size=(1, window, 1), mode="mirror"))
