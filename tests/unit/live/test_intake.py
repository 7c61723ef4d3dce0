"""Bytes to lines to the queue: bounded whatever comes."""

import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.errors import OptionsError
from posefuse.live.addresses import parse_address
from posefuse.live.line_queue import LineQueue
from posefuse.live.lines import LineSplitter, RateLimiter, Sender
from posefuse.live.statistics import Latencies
from posefuse.model.options.stream import StreamOptions
from tests.laws import examples


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


def test_a_line_without_ending_takes_bounded_memory():
    splitter = LineSplitter(1000)
    for _ in range(100):
        assert splitter.feed(b"x" * 900) == []
        assert len(splitter._begun) <= 1000
    assert splitter.feed(b"\nnext\n") == [(2, b"next")]
    assert splitter.too_long == 1


def test_a_byte_order_mark_is_removed():
    splitter = LineSplitter(100)
    assert splitter.feed(b"\xef\xbb\xbf{}\n\n[]\n") == [(1, b"{}"), (3, b"[]")]


def test_the_origin_of_a_line_is_its_sender_and_number():
    queue = LineQueue(10, waits=False)
    Sender(queue, StreamOptions(), limited=False).feed(b"\na\n")
    Sender(queue, StreamOptions(), limited=False, name="10.0.0.7:4711").feed(b"b\n")
    assert [each.origin for each in queue.take(0.0)[0]] == ["line 2", "10.0.0.7:4711 line 1"]


def test_the_rate_limit_allows_bursts_of_one_second():
    allowance = RateLimiter(10.0, 0.0)
    assert [allowance.spend(0.0) for _ in range(12)].count(True) == 10
    assert sum(allowance.spend(1.0 + 0.01 * i) for i in range(1000)) == pytest.approx(10 + 100, abs=1)


def test_a_flood_is_counted():
    queue = LineQueue(1000, waits=False, clock=lambda: 0.0)
    sender = Sender(queue, StreamOptions(max_messages_hz=5.0, max_line_bytes=8), limited=True)
    sender.feed(b"a\n" * 7 + b"much too long\n")
    assert [each.line for each in queue.take(0.0)[0]] == [b"a"] * 5
    assert queue.lost == {"more than max_messages_hz": 2, "longer than max_line_bytes": 1}


def test_the_oldest_are_dropped_and_counted():
    queue = LineQueue(3, waits=False)
    for i in range(5):
        queue.put(b"%d" % i)
    assert [each.line for each in queue.take(0.0)[0]] == [b"2", b"3", b"4"]
    assert queue.lost == {"queue full": 2}


def test_the_sender_waits_while_the_queue_is_full():
    queue = LineQueue(3, waits=True)
    thread = threading.Thread(target=lambda: [queue.put(b"%d" % i) for i in range(50)])
    thread.start()
    taken = []
    while len(taken) < 50:
        lines, _ = queue.take(1.0, 1)
        taken += [int(each.line) for each in lines]
    thread.join()
    assert taken == list(range(50))
    assert not queue.lost


def test_a_closed_queue_blocks_neither_side():
    queue = LineQueue(1, waits=True)
    queue.put(b"a")
    queue.close()
    queue.put(b"b")
    assert not queue.finished
    assert [each.line for each in queue.take(60.0)[0]] == [b"a"]
    assert queue.lost == {"received after the end": 1}
    assert queue.finished
    assert queue.take(60.0)[0] == []


@pytest.mark.parametrize(
    ("text", "shown", "is_open"),
    [
        ("-", "stdin", False),
        ("tcp://:5570", "tcp://127.0.0.1:5570", False),
        ("tcp://localhost:0", "tcp://localhost:0", False),
        ("tcp://0.0.0.0:5570", "tcp://0.0.0.0:5570", True),
        ("tcp://[::1]:5570", "tcp://[::1]:5570", False),
        ("tcp://[::]:5570", "tcp://[::]:5570", True),
        ("zmq+pull://somewhere:5570", "zmq+pull://somewhere:5570", True),
        ("zmq+sub://somewhere:5570/pose", "zmq+sub://somewhere:5570/pose", False),
        ("nats://somewhere/pose.left", "nats://somewhere:4222/pose.left", False),
        ("unix:/tmp/s", "unix:/tmp/s", False),
        ("unix:///tmp/s", "unix:/tmp/s", False),
    ],
)
def test_addresses(text, shown, is_open):
    address = parse_address(text)
    assert (str(address), address.is_open) == (shown, is_open)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("5570", "Valid forms"),
        ("tpc://x:1", "Did you mean 'tcp'?"),
        ("udp://:1", "unix:/tmp/posefuse.sock"),
        ("tcp://x", "the port is missing"),
        ("tcp://5570", "as in tcp://127.0.0.1:5570"),
        ("tcp://x:99999", "Port out of range"),
        ("tcp://x:1/y", "takes no name"),
        ("nats://x", "the subject is missing"),
        ("unix:", "the path of the socket is missing"),
        ("tcp://me:secret@x:1", "optionally a name"),
    ],
)
def test_invalid_addresses(text, said):
    with pytest.raises(OptionsError, match=said.replace("?", r"\?")):
        parse_address(text)


@given(st.lists(st.floats(1e-5, 100.0), min_size=1, max_size=200), st.floats(0.01, 1.0))
@examples(60)
def test_quantiles_are_right_to_six_percent(values, share):
    latencies = Latencies()
    for value in values:
        latencies.add(value)
    exact = sorted(values)[max(0, -(-int(share * 1e9) * len(values) // 10**9) - 1)]
    assert exact * 0.999 <= latencies.quantile_s(share) <= exact * 1.061
