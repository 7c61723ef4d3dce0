"""``posefuse stream``."""

import gc
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter
from rich.table import Table
from rich.text import Text

from posefuse.cli.console import count, err, warn
from posefuse.cli.types import OptionFlags
from posefuse.errors import OptionsError, choices
from posefuse.model.options.flags import as_flags
from posefuse.model.options.options import Options
from posefuse.model.options.stream import StreamOptions

if TYPE_CHECKING:
    from posefuse.live.addresses import Address
    from posefuse.live.line_queue import LineQueue
    from posefuse.live.session import Session
    from posefuse.live.sinks import Sink

_SWITCH_INTERVAL_S = 0.0005
_INPUT_HELP = (
    "Source of lines: - (stdin), tcp://127.0.0.1:PORT or unix:PATH (listens), zmq+pull://127.0.0.1:PORT "
    "(listens), zmq+sub://HOST:PORT or nats://HOST:PORT/SUBJECT (connects)."
)
_OUTPUT_HELP = (
    "Destinations of lines: stdout, tcp://127.0.0.1:PORT or unix:PATH (listens), zmq+push://HOST:PORT (connects), "
    "zmq+pub://127.0.0.1:PORT/TOPIC (listens) or nats://HOST:PORT/SUBJECT (connects)."
)


def stream(
    *,
    calibration: Annotated[Path, Parameter(help="Calibration file; messages use its camera names.")],
    input: Annotated[str, Parameter(name=["--input", "-i"], help=_INPUT_HELP)] = "-",  # noqa: A002
    output: Annotated[tuple[str, ...], Parameter(name=["--output", "-o"], help=_OUTPUT_HELP)] = ("stdout",),
    stream: Annotated[StreamOptions, Parameter(name="*", group=Group("Stream", sort_key=1))] = StreamOptions(),  # noqa: B008
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Track people live: one JSON line per camera and time in, one JSON line per frame out.

    docs/live.md describes the lines. --skeleton names the keypoints. The command ends with the input or with Ctrl-C.
    Late, lost and malformed lines are counted in the stream's report lines and printed on stderr at the end.
    """
    from posefuse.live.addresses import OUTPUT, Address, parse_address
    from posefuse.live.line_queue import LineQueue
    from posefuse.live.run import run_stream
    from posefuse.live.sources import Source
    from posefuse.live.warm_up import warm_up

    address = parse_address(input)
    outputs = [parse_address(text, OUTPUT) for text in dict.fromkeys(output)]
    # If messages define the time, the same lines must give the same bytes, so none is dropped.
    waits = address.kind == "stdin" or stream.clock == "messages"
    stream = replace(stream, when_behind=stream.when_behind or ("wait" if waits else "drop"))
    session = _session(calibration, stream, options)
    for each in (each for each in (address, *outputs) if each.is_open):
        warn(f"{each} accepts unauthenticated connections from the network; use only on a trusted network.")
    warm_up(session, options)
    queue = LineQueue(stream.queue_messages, waits=stream.when_behind == "wait")
    source = Source(address, queue, stream)
    with _end_on_signals(queue), _opened_sinks(outputs, stream) as sinks:
        _print_ready(source.start(), sinks)
        gc.collect()
        # The objects created so far are permanent; collecting them repeatedly would take milliseconds of a frame.
        gc.freeze()
        try:
            with _short_switch_interval():
                run_stream(session, queue, partial(_write, sinks, to_stdout=Address("stdout") in outputs), warn)
        except BrokenPipeError:
            warn("The output was closed by its reader.")
            sys.stdout = open("/dev/null", "w")  # noqa: SIM115
        finally:
            gc.unfreeze()
            source.close()
            for sink in sinks:
                sink.close()
            print_counts(session, sinks)
    if session.counts.lines and not any(each.received for each in session.grouper.counts):
        warn("No line of the input was valid.")
        sys.exit(1)


def _session(calibration: Path, stream: StreamOptions, options: Options) -> "Session":
    from posefuse.io.calibration.read import read_cameras
    from posefuse.io.files import must_exist
    from posefuse.live.session import Session
    from posefuse.skeleton.skeletons import shipped_skeletons

    if options.skeleton is None:
        raise OptionsError(
            "--skeleton is required; it defines the keypoints of the messages and their order. Specify a shipped "
            f"skeleton ({choices(shipped_skeletons(), 20)}) or a TOML file."
        )
    rig = read_cameras(must_exist(calibration, "calibration"), length_unit=options.length_unit, up=options.up)
    wanted = options.cameras or tuple(name for name in rig.names if name not in options.exclude_camera)
    return Session(rig.select(wanted), options.skeleton, options, stream)


@contextmanager
def _opened_sinks(outputs: "Sequence[Address]", stream: StreamOptions) -> "Iterator[list[Sink]]":
    """Open the sinks of all addresses but stdout; close those that are open if one fails."""
    from posefuse.live.sinks import open_sink

    sinks: list[Sink] = []
    try:
        for each in outputs:
            if each.kind != "stdout":
                sinks.append(open_sink(each, stream))
        yield sinks
    except BaseException:
        for sink in sinks:
            sink.close()
        raise


def _print_ready(address: "Address", sinks: "Sequence[Sink]") -> None:
    where = f"listening on {address}" if address.listens else f"reading {address}"
    places = "".join(f", writing to {sink.address}" for sink in sinks)
    err.print(Text(f"posefuse stream: ready, {where}{places}"), soft_wrap=True)


def _write(sinks: "Sequence[Sink]", line: bytes, *, to_stdout: bool) -> None:
    for sink in sinks:
        sink.write(line)
    if to_stdout:
        sys.stdout.buffer.write(line)
        sys.stdout.buffer.flush()


@contextmanager
def _end_on_signals(queue: "LineQueue") -> Iterator[None]:
    """End the stream on SIGINT and SIGTERM after the received lines are processed.

    A second signal ends it at once, since the reader of the output may have stopped.
    """

    def end(*_: Any) -> None:
        if queue.closed:
            raise KeyboardInterrupt
        queue.close()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _short_switch_interval() -> Iterator[None]:
    """Shorten the interpreter's switch interval, so that lines are received soon after they arrive."""
    default_s = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(default_s)


def print_counts(session: "Session", sinks: "Sequence[Sink]" = ()) -> None:
    """Print the counts of a stream and its sinks on stderr."""
    counts = session.counts
    frames = counts.complete + counts.incomplete
    _print(
        f"{count(counts.lines, 'line')}, {count(frames, 'frame')}: {counts.complete} complete, "
        f"{counts.incomplete} incomplete; dropped {counts.frames_dropped}"
    )
    for kind, latencies in (("complete", counts.complete_s), ("incomplete", counts.incomplete_s)):
        if len(latencies):
            p50, p99, most = (
                1e3 * x for x in (latencies.quantile_s(0.5), latencies.quantile_s(0.99), latencies.most_s)
            )
            _print(f"latency of {kind} frames: p50 {p50:.1f} ms, p99 {p99:.1f} ms, maximum {most:.1f} ms")
    for what, number in sorted(counts.malformed.items()):
        _print(f"malformed: {count(number, 'line')}, {what}")
    for why, number in sorted(counts.lost.items()):
        _print(f"dropped: {count(number, 'line')}, {why}")
    for sink in sinks:
        dropped = ", ".join(f"{number} {why}" for why, number in sorted(sink.counts.dropped.items()))
        sent, reasons = count(sink.counts.sent, "line"), f" ({dropped})" if dropped else ""
        _print(f"{sink.address}: {sent} sent, {sink.counts.dropped.total()} dropped{reasons}")
    if counts.refused:
        _print(f"refused by the tracker: {count(counts.refused, 'frame')}")
    if session.grouper.jumps:
        _print(f"clocks of most cameras jumped {count(session.grouper.jumps, 'time')}")
    columns = ("used", "missing", "late", "early", "duplicate", "out_of_order", "malformed")
    view = Table(box=None, pad_edge=False, header_style="bold")
    view.add_column("camera", overflow="fold")
    for column in columns:
        view.add_column(column.replace("_", " "), justify="right", overflow="fold")
    for name, of_view in session.by_camera():
        view.add_row(Text(name), *(str(getattr(of_view, column)) for column in columns))
    err.print(view)


def _print(text: str) -> None:
    err.print(Text(as_flags(text)))
