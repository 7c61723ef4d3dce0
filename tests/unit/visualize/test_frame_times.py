"""Assignment of times to frames."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.visualize.frame_times import FrameTimes
from tests.videos import RATE_HZ, moving_sticks


def frame_times_of(numbers: list[int]) -> FrameTimes:
    result = moving_sticks(n_frames=len(numbers))
    return FrameTimes.of(replace(result, frame_numbers=np.array(numbers), time_s=np.array(numbers) / RATE_HZ))


def test_nearest_frame_is_within_half_a_period():
    frame_times = frame_times_of([3, 4, 5, 6])
    for place, number in enumerate((3, 4, 5, 6)):
        for off in (-0.49, 0.0, 0.49):
            assert frame_times.nearest((number + off) / RATE_HZ) == place
    assert frame_times.nearest(2.4 / RATE_HZ) is None
    assert frame_times.nearest(6.6 / RATE_HZ) is None


def test_times_in_a_gap_have_no_frame():
    frame_times = frame_times_of([0, 1, 9, 10])
    assert [frame_times.nearest(n / RATE_HZ) for n in (1, 5, 9)] == [1, None, 2]


def test_frame_times_are_interpolated_and_extrapolated():
    frame_times = frame_times_of([2, 3, 7])
    assert [frame_times.time_of_number(n) for n in (0, 2, 5, 7, 10)] == pytest.approx(
        [n / RATE_HZ for n in (0, 2, 5, 7, 10)]
    )


def test_indices_between_times():
    frame_times = frame_times_of([0, 1, 2, 3, 4])
    assert list(frame_times.indices_between(1 / RATE_HZ, 3 / RATE_HZ)) == [1, 2]
    assert list(frame_times.indices_between(None, None)) == [0, 1, 2, 3, 4]
    assert list(frame_times.indices_between(9.0, None)) == []


def test_frame_numbers_replace_missing_times():
    result = replace(moving_sticks(n_frames=3), time_s=np.full(3, np.nan), rate_hz=None)
    frame_times = FrameTimes.of(result, 50.0)
    assert not frame_times.timed
    assert frame_times.time_of_number(2) == pytest.approx(2 / 50)
