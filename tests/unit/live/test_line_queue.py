"""Queue of lines."""

import threading

from posefuse.live.line_queue import LineQueue


def test_oldest_are_dropped_and_counted():
    queue = LineQueue(3, waits=False)
    for i in range(5):
        queue.put(b"%d" % i)
    assert [each.line for each in queue.take(0.0)[0]] == [b"2", b"3", b"4"]
    assert queue.lost == {"queue full": 2}


def test_sender_waits_while_the_queue_is_full():
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


def test_closed_queue_blocks_neither_side():
    queue = LineQueue(1, waits=True)
    queue.put(b"a")
    queue.close()
    queue.put(b"b")
    assert not queue.finished
    assert [each.line for each in queue.take(60.0)[0]] == [b"a"]
    assert queue.lost == {"received after the end": 1}
    assert queue.finished
    assert queue.take(60.0)[0] == []
