"""Statistics of a live session."""

from hypothesis import given
from hypothesis import strategies as st

from posefuse.live.statistics import Latencies
from tests.properties import examples


@given(st.lists(st.floats(1e-5, 100.0), min_size=1, max_size=200), st.floats(0.01, 1.0))
@examples(60)
def test_quantiles_are_accurate_to_six_percent(values, share):
    latencies = Latencies()
    for value in values:
        latencies.add(value)
    exact = sorted(values)[max(0, -(-int(share * 1e9) * len(values) // 10**9) - 1)]
    assert exact * 0.999 <= latencies.quantile_s(share) <= exact * 1.061
