"""Which frame a time belongs to."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.visualize.clock import Clock
from tests.videos import RATE_HZ, moving_sticks


def clock_of(numbers: list[int]) -> Clock:
    result = moving_sticks(n_frames=len(numbers))
    return Clock.of(replace(result, frame_numbers=np.array(numbers), time_s=np.array(numbers) / RATE_HZ))


def test_every_time_within_half_a_frame_belongs_to_it():
    clock = clock_of([3, 4, 5, 6])
    for place, number in enumerate((3, 4, 5, 6)):
        for off in (-0.49, 0.0, 0.49):
            assert clock.nearest((number + off) / RATE_HZ) == place
    assert clock.nearest(2.4 / RATE_HZ) is None
    assert clock.nearest(6.6 / RATE_HZ) is None


def test_a_gap_belongs_to_nobody():
    clock = clock_of([0, 1, 9, 10])
    assert [clock.nearest(n / RATE_HZ) for n in (1, 5, 9)] == [1, None, 2]


def test_numbers_have_times_also_beyond_and_between():
    clock = clock_of([2, 3, 7])
    assert [clock.time_of_number(n) for n in (0, 2, 5, 7, 10)] == pytest.approx([n / RATE_HZ for n in (0, 2, 5, 7, 10)])


def test_places_between_times():
    clock = clock_of([0, 1, 2, 3, 4])
    assert list(clock.places(1 / RATE_HZ, 3 / RATE_HZ)) == [1, 2]
    assert list(clock.places(None, None)) == [0, 1, 2, 3, 4]
    assert list(clock.places(9.0, None)) == []


def test_without_times_numbers_count():
    result = replace(moving_sticks(n_frames=3), time_s=np.full(3, np.nan), rate_hz=None)
    clock = Clock.of(result, 50.0)
    assert not clock.timed
    assert clock.time_of_number(2) == pytest.approx(2 / 50)
