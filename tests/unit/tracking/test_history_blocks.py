"""Blocks of a history return the same entries in memory and in a spool, also when a thread moves them."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from posefuse.tracking.history_blocks import Block
from posefuse.tracking.history_entries import Entries
from tests.unit.tracking.test_history_entries import add


class Values(list[Any]):
    """A spool in memory."""

    def add(self, value: Any) -> int:
        self.append(value)
        return len(self) - 1


def block_of(places: range) -> Block:
    block = Block(places.start)
    for place in places:
        add(block.table, place, {7: place + 0.5, 3: place + 0.25})
    return block


def same(found: dict[int, Entries], expected: dict[int, Entries]) -> None:
    assert list(found) == list(expected) == [7, 3]
    for number, entries in expected.items():
        for field in fields(Entries):
            np.testing.assert_array_equal(getattr(found[number], field.name), getattr(entries, field.name))


def test_thread_moves_the_same_entries():
    moved, expected, spools = block_of(range(10, 18)), block_of(range(10, 18)), (Values(), Values())
    with ThreadPoolExecutor(1) as thread:
        moved.spool(spools[0], thread)
        moved.settle()
    expected.spool(spools[1])
    same(spools[0][0], spools[1][0])
    same(spools[0][0], block_of(range(10, 18)).joined(0, 20))
    assert moved.spooled_at == expected.spooled_at == 0
    assert not len(moved.table)


def test_error_of_the_thread_is_raised():
    class Full(Values):
        def add(self, value: Any) -> int:
            raise OSError("full")

    block = block_of(range(2))
    with ThreadPoolExecutor(1) as thread:
        block.spool(Full(), thread)
        with pytest.raises(OSError, match="full"):
            block.settle()
