"""Output lines over real sockets; tracking never waits for a consumer."""

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from posefuse.errors import StreamError
from posefuse.live.addresses import OUTPUT, parse_address
from posefuse.live.outbox import NOT_TAKEN, QUEUE_FULL
from posefuse.live.sinks import DISCONNECTED, NO_CONSUMER, TRANSPORTS, Sink, open_sink
from posefuse.model.options.stream import StreamOptions
from tests.unit.live.test_sources import PATIENCE_S, until

OPTIONS = StreamOptions(queue_lines=1000)
SOON_S = 1.0
"""Much less than sending to a stalled consumer would take."""


@contextmanager
def sending(text: str, options: StreamOptions = OPTIONS) -> Iterator[Sink]:
    sink = open_sink(parse_address(text, OUTPUT), options)
    try:
        yield sink
    finally:
        sink.close()


def connected(sink: Sink) -> socket.socket:
    address = sink.address
    if address.kind == "tcp":
        connection = socket.create_connection((address.host, address.port))
    else:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.connect(address.name)
    connection.settimeout(PATIENCE_S)
    return connection


def received(connection: socket.socket, number: int) -> list[bytes]:
    with connection.makefile("rb") as file:
        return [file.readline() for _ in range(number)]


def test_every_output_form_has_one_transport():
    kinds = [parse_address(text, OUTPUT).kind for text in OUTPUT.examples]
    assert sorted(kinds) == sorted(["stdout", *(each.kind for each in TRANSPORTS)])


@pytest.mark.parametrize("kind", ["tcp", "unix"])
def test_all_consumers_receive_all_lines(kind, tmp_path):
    text = "tcp://:0" if kind == "tcp" else f"unix:{tmp_path / 's'}"
    with sending(text) as sink:
        sink.write(b"start\n")
        with connected(sink) as one, connected(sink) as other:
            assert received(one, 1) == received(other, 1) == [b"start\n"]
            for i in range(100):
                sink.write(b"%d\n" % i)
            expected = [b"%d\n" % i for i in range(100)]
            assert received(one, 100) == received(other, 100) == expected
    assert sink.counts.sent == 202
    assert not sink.counts.dropped
    assert not (tmp_path / "s").exists()


def test_waiting_lines_are_sent_at_the_end():
    with sending("tcp://:0") as sink:
        sink.write(b"start\n")
        consumer = connected(sink)
        assert received(consumer, 1) == [b"start\n"]
        for _ in range(500):
            sink.write(b"line\n")
    with consumer, consumer.makefile("rb") as file:
        assert len(file.readlines()) == 500


def test_a_stalled_consumer_does_not_delay_writing():
    """It does not read: its queue drops the oldest lines, and another consumer receives everything."""
    line = b"x" * 9_999 + b"\n"
    with sending("tcp://:0", replace(OPTIONS, queue_lines=50)) as sink:
        sink.write(b"start\n")
        with connected(sink) as stalled, connected(sink) as reader:
            assert received(reader, 1) == received(stalled, 1) == [b"start\n"]
            start_s = time.monotonic()
            for _ in range(40):
                for _ in range(50):
                    sink.write(line)
                assert received(reader, 50) == [line] * 50
            until(lambda: sink.counts.dropped[QUEUE_FULL] > 100)
            assert time.monotonic() - start_s < PATIENCE_S
            start_s = time.monotonic()
            sink.close()
            assert time.monotonic() - start_s < 10.0
    assert sink.counts.dropped[QUEUE_FULL] + sink.counts.dropped[NOT_TAKEN] + sink.counts.sent >= 2 * 2000
    assert sink.counts.sent < 2 * 2001


def test_a_lost_consumer_is_counted_and_another_can_connect():
    with sending("tcp://:0") as sink:
        sink.write(b"start\n")
        sink.write(b"nobody\n")
        assert sink.counts.dropped == {NO_CONSUMER: 1}
        with connected(sink) as consumer:
            assert received(consumer, 1) == [b"start\n"]

        def lost() -> bool:
            sink.write(b"line\n")
            return sink.counts.dropped[DISCONNECTED] > 0

        until(lost)
        with connected(sink) as consumer:
            assert received(consumer, 1) == [b"start\n"]
            sink.write(b"again\n")
            assert received(consumer, 1)[0] in (b"line\n", b"again\n")


def test_an_address_in_use_is_an_error(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with pytest.raises(StreamError, match="Cannot listen on tcp"):
            open_sink(parse_address(f"tcp://127.0.0.1:{port}", OUTPUT), OPTIONS)
    file = Path(tmp_path / "file")
    file.touch()
    with pytest.raises(StreamError, match="Cannot listen on unix"):
        open_sink(parse_address(f"unix:{file}", OUTPUT), OPTIONS)
