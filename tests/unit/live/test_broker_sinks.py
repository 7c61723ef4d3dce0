"""Output lines through ZeroMQ and NATS on the loopback device; the NATS server is a tiny one."""

import socket
import socketserver
import threading
import time

import pytest

from posefuse.errors import StreamError
from posefuse.live.addresses import OUTPUT, parse_address
from posefuse.live.outbox import NOT_TAKEN, QUEUE_FULL
from posefuse.live.sinks import open_sink
from posefuse.model.options.stream import StreamOptions
from tests.unit.live.test_sinks import sending
from tests.unit.live.test_sources import PATIENCE_S, until

LINES = [b"%d" % i for i in range(200)]


def test_zeromq_push():
    zmq = pytest.importorskip("zmq", reason="pyzmq is not installed (extra live)")
    with zmq.Context() as context, context.socket(zmq.PULL) as consumer:
        consumer.setsockopt(zmq.RCVTIMEO, int(1000 * PATIENCE_S))
        port = consumer.bind_to_random_port("tcp://127.0.0.1")
        with sending(f"zmq+push://127.0.0.1:{port}") as sink:
            for line in LINES:
                sink.write(line + b"\n")
        assert [consumer.recv() for _ in LINES] == LINES
    assert (sink.counts.sent, sink.counts.dropped) == (len(LINES), {})


def test_zeromq_publisher_sends_topic_and_line():
    zmq = pytest.importorskip("zmq", reason="pyzmq is not installed (extra live)")
    with (
        sending("zmq+pub://127.0.0.1:0/pose") as sink,
        zmq.Context() as context,
        context.socket(zmq.SUB) as consumer,
    ):
        consumer.setsockopt(zmq.SUBSCRIBE, b"pose")
        consumer.connect(f"tcp://127.0.0.1:{sink.address.port}")

        def subscribed() -> bool:
            sink.write(b"hello\n")
            return bool(consumer.poll(10))

        until(subscribed)
        sink.write(b"last\n")
        parts = consumer.recv_multipart()
        while parts[-1] != b"last":
            assert parts == [b"pose", b"hello"]
            parts = consumer.recv_multipart()


@pytest.mark.parametrize("kind", ["push", "pub"])
def test_a_missing_or_slow_zeromq_consumer_does_not_delay_writing(kind):
    zmq = pytest.importorskip("zmq", reason="pyzmq is not installed (extra live)")
    options = StreamOptions(queue_lines=20)
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    line = b"x" * 99_999 + b"\n"
    with zmq.Context() as context, context.socket(zmq.SUB) as slow:
        sink = open_sink(parse_address(f"zmq+{kind}://127.0.0.1:{port if kind == 'push' else 0}", OUTPUT), options)
        if kind == "pub":
            slow.setsockopt(zmq.RCVHWM, 1)
            slow.setsockopt(zmq.SUBSCRIBE, b"")
            slow.connect(f"tcp://127.0.0.1:{sink.address.port}")

        def dropped() -> bool:
            start_s = time.monotonic()
            sink.write(line)
            assert time.monotonic() - start_s < PATIENCE_S / 2
            return sink.counts.dropped[QUEUE_FULL] > 20

        until(dropped)
        start_s = time.monotonic()
        sink.close()
        assert time.monotonic() - start_s < 10.0
        slow.setsockopt(zmq.LINGER, 0)
    assert sink.counts.dropped[NOT_TAKEN] > 0


class TinyNats(socketserver.StreamRequestHandler):
    """As much of a NATS server as one publisher needs: the text protocol of NATS, INFO to PUB."""

    published: list[tuple[bytes, bytes]]

    def handle(self) -> None:
        self.wfile.write(b'INFO {"server_id":"A","version":"2.10.0","proto":1,"max_payload":1000,"headers":true}\r\n')
        for line in self.rfile:
            word, *rest = line.split()
            if word == b"PING":
                self.wfile.write(b"PONG\r\n")
            elif word == b"PUB":
                self.published.append((rest[0], self.rfile.read(int(rest[-1]))))
                self.rfile.readline()


@pytest.fixture
def nats_server():
    pytest.importorskip("nats", reason="nats-py is not installed (extra live)")
    handler = type("Handler", (TinyNats,), {"published": []})
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), handler) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        yield server.server_address[1], handler.published
        server.shutdown()


def test_nats_publishes_every_line(nats_server):
    port, published = nats_server
    with sending(f"nats://127.0.0.1:{port}/pose.out") as sink:
        for line in LINES:
            sink.write(line + b"\n")
        sink.write(b"x" * 2000 + b"\n")
    until(lambda: len(published) == len(LINES))
    assert published == [(b"pose.out", line) for line in LINES]
    assert sink.counts.sent == len(LINES)
    assert sink.counts.dropped == {"larger than the server accepts": 1}


def test_missing_nats_server_is_an_error():
    pytest.importorskip("nats", reason="nats-py is not installed (extra live)")
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(StreamError, match="Is it running"):
        open_sink(parse_address(f"nats://127.0.0.1:{port}/pose", OUTPUT), StreamOptions())
