"""The percentile in two passes against NumPy's, which needs all numbers in memory."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.triangulation.exact_percentile import exact_percentile
from tests.properties import examples

NUMBERS = st.one_of(
    st.floats(0.0, 2.0**100, width=32), st.sampled_from([0.0, 1.0, 2.0]), st.floats(1.0, 1.0078125, width=32)
)


@given(
    values=st.lists(NUMBERS, min_size=1, max_size=60),
    percent=st.one_of(st.floats(0.0, 100.0), st.sampled_from([0.0, 50.0, 90.0, 100.0])),
    size=st.integers(1, 60),
    method=st.sampled_from(["linear", "weibull"]),
)
@examples(40)
def test_equals_numpy_for_parts_of_any_size(values, percent, size, method):
    array = np.array(values, dtype=np.float32)
    weibull = method == "weibull"
    parts = [array[i : i + size] for i in range(0, len(array), size)]
    found = exact_percentile(lambda: parts, percent, weibull=weibull)
    assert found == exact_percentile(lambda: [array], percent, weibull=weibull)
    expected = float(np.percentile(array.astype(np.float64), percent, method=method))
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-300)


def test_numbers_that_are_not_finite_do_not_count():
    values = np.array([np.nan, 1.0, np.inf, 3.0], dtype=np.float32)
    assert exact_percentile(lambda: [values], 50.0) == 2.0


@pytest.mark.parametrize("parts", [[], [np.empty(0, np.float32)], [np.array([np.nan], np.float32)]])
def test_none_without_numbers(parts):
    assert exact_percentile(lambda: parts, 50.0) is None
