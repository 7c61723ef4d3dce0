"""Splitting of bytes into lines, and the rate limit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.live.line_queue import LineQueue
from posefuse.live.lines import LineSplitter, RateLimiter, Sender
from posefuse.model.options.stream import StreamOptions
from tests.properties import examples


@given(st.lists(st.binary(max_size=30), max_size=12), st.lists(st.integers(1, 9), min_size=1, max_size=9))
@examples(150)
def test_lines_do_not_depend_on_how_bytes_are_split(pieces, sizes):
    whole = b"\n".join(pieces)
    splitter, lines, at = LineSplitter(10), [], 0
    for i in range(len(whole)):
        size = sizes[i % len(sizes)]
        lines += splitter.feed(whole[at : at + size])
        at += size
        assert len(splitter._begun) <= 10
    lines += splitter.end()
    expected = [(number, line) for number, line in enumerate(whole.split(b"\n"), 1) if line.strip()]
    assert lines == [(number, line) for number, line in expected if len(line) <= 10]
    assert splitter.too_long == sum(len(line) > 10 for line in whole.split(b"\n"))


def test_line_without_ending_takes_bounded_memory():
    splitter = LineSplitter(1000)
    for _ in range(100):
        assert splitter.feed(b"x" * 900) == []
        assert len(splitter._begun) <= 1000
    assert splitter.feed(b"\nnext\n") == [(2, b"next")]
    assert splitter.too_long == 1


def test_byte_order_mark_is_removed():
    splitter = LineSplitter(100)
    assert splitter.feed(b"\xef\xbb\xbf{}\n\n[]\n") == [(1, b"{}"), (3, b"[]")]


def test_origin_of_a_line_is_its_sender_and_number():
    queue = LineQueue(10, waits=False)
    Sender(queue, StreamOptions(), limited=False).feed(b"\na\n")
    Sender(queue, StreamOptions(), limited=False, name="10.0.0.7:4711").feed(b"b\n")
    assert [each.origin for each in queue.take(0.0)[0]] == ["line 2", "10.0.0.7:4711 line 1"]


def test_rate_limit_allows_bursts_of_one_second():
    allowance = RateLimiter(10.0, 0.0)
    assert [allowance.spend(0.0) for _ in range(12)].count(True) == 10
    assert sum(allowance.spend(1.0 + 0.01 * i) for i in range(1000)) == pytest.approx(10 + 100, abs=1)


def test_flood_is_counted():
    queue = LineQueue(1000, waits=False, clock=lambda: 0.0)
    sender = Sender(queue, StreamOptions(max_messages_hz=5.0, max_line_bytes=8), limited=True)
    sender.feed(b"a\n" * 7 + b"much too long\n")
    assert [each.line for each in queue.take(0.0)[0]] == [b"a"] * 5
    assert queue.lost == {"more than max_messages_hz": 2, "longer than max_line_bytes": 1}
