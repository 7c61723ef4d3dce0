"""Samples of every n-th frame do not depend on chunks and have a bounded size."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from posefuse.model.thinned_samples import Thinned
from tests.properties import examples


@examples(60)
@given(
    st.lists(st.integers(0, 40), min_size=1, max_size=12).filter(lambda sizes: sum(sizes) > 0),
    st.integers(1, 60),
)
def test_sample_depends_on_the_frames_only(sizes, rows):
    values = np.arange(3.0 * sum(sizes)).reshape(-1, 3)
    whole, parts = Thinned(24 * rows), Thinned(24 * rows)
    whole.add(values)
    for part in np.split(values, np.cumsum(sizes)[:-1]):
        parts.add(part)
    kept = whole.values
    assert 1 <= len(kept) <= rows
    assert len(kept) > rows // 2 or len(kept) == len(values)
    np.testing.assert_array_equal(parts.values, kept)
    np.testing.assert_array_equal(kept, values[:: len(values) if len(kept) < 2 else int((kept[1, 0] - kept[0, 0]) / 3)])
