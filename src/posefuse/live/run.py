"""The main loop of a stream: lines from the queue into the session, and its output lines out."""

from collections.abc import Callable

from posefuse.live.camera_warnings import CHECK_PERIOD_S
from posefuse.live.line_queue import LineQueue
from posefuse.live.session import Session

_IDLE_S = 0.1
_SOON_S = 0.005


def run_stream(session: Session, queue: LineQueue, write: Callable[[bytes], None], warn: Callable[[str], None]) -> None:
    """Track people until the queue is finished.

    Args:
        session: session of the stream.
        queue: queue of input lines.
        write: writes an output line.
        warn: receives sentences on lines that could not be used, the first few of each kind, and on cameras that are
            silent or have wrong clocks.

    Raises:
        StreamError: if receiving ended with an error, after all earlier lines were processed.
    """
    write(session.start_line())
    by_messages = session.stream.clock == "messages"
    report_at_s = queue.clock() + session.stream.report_every_s
    check_at_s = queue.clock() + CHECK_PERIOD_S
    while not queue.finished:
        lines, until_s = queue.take(_timeout_s(session, queue.clock()), None if session.drops else 1)
        for each in lines:
            why = session.take(each.line, each.at_s)
            if why is not None:
                warn(f"{each.origin}: {why}")
        session.tick(until_s)
        _process(session, queue, write, all_frames=not session.drops)
        if queue.clock() >= check_at_s:
            check_at_s = queue.clock() + CHECK_PERIOD_S
            for sentence in session.check_cameras(until_s):
                warn(sentence)
        if not by_messages and queue.clock() >= report_at_s:
            report_at_s += session.stream.report_every_s
            _report(session, queue, write, last=False)
    session.end(queue.clock())
    _process(session, queue, write, all_frames=True)
    _report(session, queue, write, last=True)
    if queue.failure is not None:
        raise queue.failure


def _timeout_s(session: Session, now_s: float) -> float:
    """Return how long to wait for a line."""
    if session.waiting:
        return 0.0
    wakes_s = session.grouper.wakes_at_s()
    if wakes_s is None:
        return _IDLE_S
    return min(max(wakes_s - now_s, 0.0) or _SOON_S, _IDLE_S)


def _process(session: Session, queue: LineQueue, write: Callable[[bytes], None], *, all_frames: bool) -> None:
    """Process one complete frame, or all; between two frames more lines may have arrived."""
    while session.waiting:
        line = session.process_frame(queue.clock)
        if line is not None:
            write(line)
        if not all_frames:
            return


def _report(session: Session, queue: LineQueue, write: Callable[[bytes], None], *, last: bool) -> None:
    session.counts.lost = queue.lost
    write(session.report_line(last=last))
