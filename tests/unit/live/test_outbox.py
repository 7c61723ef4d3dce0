"""The bounded queue of a consumer."""

import threading

from posefuse.live.outbox import QUEUE_FULL, Outbox, SinkCounts


def test_the_oldest_lines_are_dropped_and_counted():
    counts = SinkCounts()
    outbox = Outbox(2, counts)
    for line in (b"a", b"b", b"c", b"d"):
        outbox.put(line)
    assert counts.dropped == {QUEUE_FULL: 2}
    assert [outbox.take(0.0) for _ in range(3)] == [b"c", b"d", None]


def test_a_closed_outbox_is_finished_when_it_is_empty():
    outbox = Outbox(9, SinkCounts())
    outbox.put(b"a")
    outbox.close()
    assert not outbox.finished
    assert outbox.take(60.0) == b"a"
    assert outbox.finished
    assert outbox.take(60.0) is None


def test_abandoned_lines_are_counted():
    counts = SinkCounts()
    outbox = Outbox(9, counts)
    outbox.put(b"a")
    outbox.put(b"b")
    outbox.abandon("why")
    assert counts.dropped == {"why": 2}
    assert outbox.finished


def test_taking_waits_for_a_line():
    outbox = Outbox(9, SinkCounts())
    threading.Timer(0.05, outbox.put, [b"late"]).start()
    assert outbox.take(20.0) == b"late"
