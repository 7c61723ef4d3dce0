"""The loop of a stream: lines from an inbox into a session, its lines out."""

from collections.abc import Callable

from posefuse.live.alarms import EVERY_S
from posefuse.live.inbox import Inbox
from posefuse.live.session import Session

_IDLE_S = 0.1
_SOON_S = 0.005


def run_stream(session: Session, inbox: Inbox, write: Callable[[bytes], None], told: Callable[[str], None]) -> None:
    """Follow people until the inbox is finished.

    Args:
        session: of the stream.
        inbox: where its lines come in.
        write: takes lines out, each with its end.
        told: hears, in sentences, of lines that could not be used, the first few of a kind, and of cameras that are
            silent or whose clocks are wrong.

    Raises:
        StreamError: if receiving ended by an error; after all that came before was worked on.
    """
    write(session.start_line())
    by_messages = session.stream.clock == "messages"
    report_at_s = inbox.clock() + session.stream.report_every_s
    look_at_s = inbox.clock() + EVERY_S
    while not inbox.finished:
        lines, until_s = inbox.take(_patience_s(session, inbox.clock()), None if session.drops else 1)
        for each in lines:
            why = session.take(each.line, each.at_s)
            if why is not None:
                told(f"{each.origin}: {why}")
        session.tick(until_s)
        _follow(session, inbox, write, everybody=not session.drops)
        if inbox.clock() >= look_at_s:
            look_at_s = inbox.clock() + EVERY_S
            for sentence in session.alarms(until_s):
                told(sentence)
        if not by_messages and inbox.clock() >= report_at_s:
            report_at_s += session.stream.report_every_s
            _report(session, inbox, write, last=False)
    session.end(inbox.clock())
    _follow(session, inbox, write, everybody=True)
    _report(session, inbox, write, last=True)
    if inbox.failure is not None:
        raise inbox.failure


def _patience_s(session: Session, now_s: float) -> float:
    """How long to wait for a line."""
    if session.waiting:
        return 0.0
    wakes_s = session.grouper.wakes_at_s()
    if wakes_s is None:
        return _IDLE_S
    return min(max(wakes_s - now_s, 0.0) or _SOON_S, _IDLE_S)


def _follow(session: Session, inbox: Inbox, write: Callable[[bytes], None], *, everybody: bool) -> None:
    """One frame that is ready, or all: between two of them, more lines may have come."""
    while session.waiting:
        line = session.follow(inbox.clock)
        if line is not None:
            write(line)
        if not everybody:
            return


def _report(session: Session, inbox: Inbox, write: Callable[[bytes], None], *, last: bool) -> None:
    session.counts.lost = inbox.lost
    write(session.report_line(last=last))
