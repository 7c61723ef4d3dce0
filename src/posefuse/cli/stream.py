"""``posefuse stream``."""

import gc
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter
from rich.table import Table
from rich.text import Text

from posefuse.cli.console import count, err, warn
from posefuse.cli.types import OptionFlags
from posefuse.errors import OptionsError, choices
from posefuse.model.options.options import Options
from posefuse.model.options.stream import StreamOptions

if TYPE_CHECKING:
    from posefuse.live.addresses import Address
    from posefuse.live.line_queue import LineQueue
    from posefuse.live.session import Session

_TURN_S = 0.0005
_INPUT_HELP = (
    "Where lines come from: - (stdin), tcp://127.0.0.1:PORT or unix:PATH (listens), zmq+pull://127.0.0.1:PORT "
    "(listens), zmq+sub://HOST:PORT or nats://HOST:PORT/SUBJECT (connects)."
)


def stream(
    *,
    calibration: Annotated[Path, Parameter(help="Calibration file; messages call cameras by its names.")],
    input: Annotated[str, Parameter(name=["--input", "-i"], help=_INPUT_HELP)] = "-",  # noqa: A002
    stream: Annotated[StreamOptions, Parameter(name="*", group=Group("Stream", sort_key=1))] = StreamOptions(),  # noqa: B008
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Follow people live: a JSON line of each camera and time in, a JSON line of everybody in each frame out.

    docs/live.md says what the lines hold. --skeleton says what keypoints are. Ends with the input, or with Ctrl-C; what
    was late, lost or malformed is counted in the stream's report lines, and told on stderr at the end.
    """
    from posefuse.live.addresses import parse_address
    from posefuse.live.line_queue import LineQueue
    from posefuse.live.run import run_stream
    from posefuse.live.sources import Source
    from posefuse.live.warm_up import warm_up

    address = parse_address(input)
    # Where messages tell the time, the same lines are to give the same bytes: none is dropped for being many.
    waits = address.kind == "stdin" or stream.clock == "messages"
    stream = replace(stream, when_behind=stream.when_behind or ("wait" if waits else "drop"))
    session = _session(calibration, stream, options)
    if address.is_open:
        warn(
            f"{address} listens to other machines, and asks nobody who they are. Only where the network can be trusted."
        )
    warm_up(session, options)
    inbox = LineQueue(stream.queue_messages, waits=stream.when_behind == "wait")
    source = Source(address, inbox, stream)
    with _ended_by_signals(inbox):
        _say_ready(source.start())
        gc.collect()
        # What is there by now stays: looking through it again and again would take milliseconds of a frame.
        gc.freeze()
        try:
            with _taking_turns():
                run_stream(session, inbox, _write, warn)
        except BrokenPipeError:
            warn("whoever read the lines is gone.")
            sys.stdout = open("/dev/null", "w")  # noqa: SIM115
        finally:
            gc.unfreeze()
            source.close()
            tell(session)
    if session.counts.lines and not any(each.received for each in session.grouper.counts):
        warn("No line could be used.")
        sys.exit(1)


def _session(calibration: Path, stream: StreamOptions, options: Options) -> "Session":
    from posefuse.io.calibration.read import read_cameras
    from posefuse.io.files import must_exist
    from posefuse.live.session import Session
    from posefuse.skeleton.skeletons import shipped_skeletons

    if options.skeleton is None:
        raise OptionsError(
            f"Add --skeleton: what the keypoints of the messages are, in which order. A shipped one "
            f"({choices(shipped_skeletons(), 20)}), or a TOML file."
        )
    rig = read_cameras(must_exist(calibration, "calibration"), length_unit=options.length_unit, up=options.up)
    wanted = options.cameras or tuple(name for name in rig.names if name not in options.exclude_camera)
    return Session(rig.select(wanted), options.skeleton, options, stream)


def _say_ready(address: "Address") -> None:
    where = f"listening on {address}" if address.listens else f"reading {address}"
    err.print(Text(f"posefuse stream: ready, {where}"), soft_wrap=True)


def _write(line: bytes) -> None:
    sys.stdout.buffer.write(line)
    sys.stdout.buffer.flush()


@contextmanager
def _ended_by_signals(inbox: "LineQueue") -> Iterator[None]:
    """Ctrl-C and the system's request to end are how a stream ends: what has come is still worked on.

    The second time, at once: whoever reads the lines may have stopped, and nothing would ever be worked on.
    """

    def end(*_: Any) -> None:
        if inbox.closed:
            raise KeyboardInterrupt
        inbox.close()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _taking_turns() -> Iterator[None]:
    """Whoever receives lines gets the interpreter soon after they came: what waits for it is not known to have come."""
    usual_s = sys.getswitchinterval()
    sys.setswitchinterval(_TURN_S)
    try:
        yield
    finally:
        sys.setswitchinterval(usual_s)


def tell(session: "Session") -> None:
    """Say on stderr what was counted."""
    counts = session.counts
    frames = counts.complete + counts.incomplete
    _say(
        f"{count(counts.lines, 'line')}, {count(frames, 'frame')}: {counts.complete} complete, "
        f"{counts.incomplete} without some camera; dropped {counts.frames_dropped}"
    )
    for kind, latencies in (("complete", counts.complete_s), ("incomplete", counts.incomplete_s)):
        if len(latencies):
            p50, p99, most = (
                1e3 * x for x in (latencies.quantile_s(0.5), latencies.quantile_s(0.99), latencies.most_s)
            )
            _say(f"latency of {kind} frames: p50 {p50:.1f} ms, p99 {p99:.1f} ms, most {most:.1f} ms")
    for what, number in sorted(counts.malformed.items()):
        _say(f"malformed: {count(number, 'line')}, {what}")
    for why, number in sorted(counts.lost.items()):
        _say(f"dropped: {count(number, 'line')}, {why}")
    if counts.refused:
        _say(f"refused by the tracker: {count(counts.refused, 'frame')}")
    if session.grouper.jumps:
        _say(f"clocks of most cameras jumped {count(session.grouper.jumps, 'time')}")
    columns = ("used", "missing", "late", "early", "duplicate", "out_of_order", "malformed")
    view = Table(box=None, pad_edge=False, header_style="bold")
    view.add_column("camera", overflow="fold")
    for column in columns:
        view.add_column(column.replace("_", " "), justify="right", overflow="fold")
    for name, of_view in session.by_camera():
        view.add_row(Text(name), *(str(getattr(of_view, column)) for column in columns))
    err.print(view)


def _say(text: str) -> None:
    err.print(Text(text))
