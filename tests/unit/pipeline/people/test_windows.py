"""Windows cover a recording, and the frames that influence their bodies."""

from hypothesis import given
from hypothesis import strategies as st

from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.people.windows import windows_of
from tests.properties import examples


@given(
    st.integers(1, 5000), st.floats(5.0, 120.0), st.floats(0.5, 100.0), st.floats(0.01, 40.0), st.integers(1, 600)
)  # fmt: skip
@examples(100)
def test_windows_cover_the_recording_and_the_frames_that_influence_bodies(n, rate_hz, window_s, look_ahead_s, chunk):
    actual = windows_of(
        n, rate_hz, window_s, Options(chunk_frames=chunk, tracker=TrackerOptions(look_ahead_s=look_ahead_s))
    )
    assert [each.start for each in actual] == [0, *(each.stop for each in actual[:-1])]
    assert actual[-1].stop == n
    for each in actual:
        assert 0 <= each.first <= each.start < each.stop <= each.last <= n
        assert each.start % chunk == 0
        assert each.first == 0 or each.start - each.first >= 10.0 * rate_hz
        assert each.last == n or each.last - each.stop >= look_ahead_s * rate_hz
        assert abs((each.stop - each.start) - n / len(actual)) <= max(chunk, 0.5 * n / len(actual)) + 1
