"""Tracking windows cover a recording, and tracks cut at window borders are stitched as they were."""

from hypothesis import given
from hypothesis import strategies as st

from posefuse.pipeline.people.windows import tracking_windows
from tests.properties import examples


@given(st.integers(1, 5000), st.floats(5.0, 120.0), st.floats(0.5, 100.0), st.floats(0.1, 40.0))
@examples(100)
def test_windows_cover_the_recording_and_the_memory_of_tracks(n_frames, rate_hz, window_s, remembered_s):
    actual = tracking_windows(n_frames, rate_hz, window_s, remembered_s)
    assert [each.start for each in actual] == [0, *(each.stop for each in actual[:-1])]
    assert actual[-1].stop == n_frames
    for each in actual:
        assert 0 <= each.first <= each.start < each.stop <= each.last <= n_frames
        assert each.first == 0 or each.start - each.first >= 10.0 * rate_hz
        assert each.last == n_frames or each.last - each.stop >= remembered_s * rate_hz
        assert len(actual) == 1 or abs((each.stop - each.start) * len(actual) - n_frames) <= len(actual)
