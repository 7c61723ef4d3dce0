"""Blocks of a history return the same entries packed, in a spool and frame by frame."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from posefuse.tracking.history_blocks import Block
from posefuse.tracking.history_entries import Entries


class Values(list[Any]):
    """A spool in memory."""

    def add(self, value: Any) -> int:
        self.append(value)
        return len(self) - 1


def entry(place: int, value: float) -> Entries:
    """Return an entry of one frame; the lengths are free in odd frames, which changes the size of its triangle."""
    free = place % 2
    size = 2 * 2 + free
    triangle = np.full(size * (size + 1) // 2, value)
    numbers = {field.name: np.full((1, 1), value) for field in fields(Entries)}
    numbers |= {"places": np.array([place]), "velocity": np.full((1, 2), value), "free": np.array([free])}
    return Entries(**{**numbers, "triangles": triangle})


def block_of(places: range) -> Block:
    block = Block(places.start)
    for number in (7, 3):
        for place in places:
            block.put(number, place, entry(place, place + 0.1 * number))
    return block


def same(found: dict[int, Entries], expected: dict[int, Entries]) -> None:
    assert list(found) == list(expected)
    for number, entries in expected.items():
        for field in fields(Entries):
            np.testing.assert_array_equal(getattr(found[number], field.name), getattr(entries, field.name))


@pytest.mark.parametrize("packed_after", [1, 4, 8])
@pytest.mark.parametrize("span", [(10, 18), (12, 15), (0, 11)])
def test_packed_entries_are_the_same(packed_after, span):
    block = block_of(range(10, 10 + packed_after))
    block.pack()
    for number in (7, 3):
        for place in range(10 + packed_after, 18):
            block.put(number, place, entry(place, place + 0.1 * number))
    same(block.joined(*span), block_of(range(10, 18)).joined(*span))


def test_later_entries_replace_packed_ones():
    block, expected = block_of(range(10, 18)), block_of(range(10, 18))
    block.pack()
    for each in (block, expected):
        each.put(3, 12, entry(12, -1.0))
    same(block.joined(0, 20), expected.joined(0, 20))
    block.pack()
    same(block.joined(0, 20), expected.joined(0, 20))


def test_thread_moves_the_same_entries():
    moved, expected, spools = block_of(range(10, 18)), block_of(range(10, 18)), (Values(), Values())
    with ThreadPoolExecutor(1) as thread:
        moved.spool(spools[0], thread)
        moved.settle()
    expected.spool(spools[1])
    same(spools[0][0], spools[1][0])
    assert moved.spooled_at == expected.spooled_at == 0
    assert not moved.entries


def test_error_of_the_thread_is_raised():
    class Full(Values):
        def add(self, value: Any) -> int:
            raise OSError("full")

    block = block_of(range(2))
    with ThreadPoolExecutor(1) as thread:
        block.spool(Full(), thread)
        with pytest.raises(OSError, match="full"):
            block.settle()
