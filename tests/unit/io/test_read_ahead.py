"""Reading ahead in a thread."""

import threading

import pytest

from posefuse.io.read_ahead import read_ahead


def test_items_come_in_order_from_another_thread():
    def items():
        for number in range(20):
            yield number, threading.current_thread()

    found = list(read_ahead(items(), 3))
    assert [number for number, _ in found] == list(range(20))
    assert all(thread is not threading.main_thread() for _, thread in found)


def test_no_more_than_stated_are_made_ahead():
    made = []

    def items():
        for number in range(100):
            made.append(number)
            yield number

    ahead = read_ahead(items(), 2)
    next(ahead)
    ahead.close()
    assert len(made) <= 4


def test_an_error_comes_after_the_items_before_it():
    def items():
        yield 1
        raise ZeroDivisionError

    ahead = read_ahead(items(), 2)
    assert next(ahead) == 1
    with pytest.raises(ZeroDivisionError):
        next(ahead)
