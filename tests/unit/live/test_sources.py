"""Lines over real sockets: TCP, UNIX, ZeroMQ, NATS; each server is started by its test."""

import os
import shutil
import socket
import socketserver
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from posefuse.errors import StreamError
from posefuse.live.addresses import Address, parse_address
from posefuse.live.line_queue import LineQueue
from posefuse.live.sources import Source
from posefuse.model.options.stream import StreamOptions

OPTIONS = StreamOptions(when_behind="drop", max_line_bytes=1000)
PATIENCE_S = 20.0


@contextmanager
def receiving(text: str, options: StreamOptions = OPTIONS) -> Iterator[tuple[Address, LineQueue]]:
    queue = LineQueue(options.queue_messages, waits=False)
    source = Source(parse_address(text), queue, options)
    try:
        yield source.start(), queue
    finally:
        source.close()
        assert not source._thread.is_alive()


def receive_lines(queue: LineQueue, number: int) -> list[bytes]:
    lines: list[bytes] = []
    until = time.monotonic() + PATIENCE_S
    while len(lines) < number and time.monotonic() < until:
        lines += [each.line for each in queue.take(0.05)[0]]
    return lines


def until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not true() and time.monotonic() < end:
        time.sleep(0.01)
    assert true()


def test_lines_over_tcp():
    with receiving("tcp://:0") as (address, queue):
        assert address.host == "127.0.0.1"
        place = (address.host, address.port)
        with socket.create_connection(place) as one, socket.create_connection(place) as other:
            one.sendall(b"begun ")
            other.sendall(b"whole\n")
            assert receive_lines(queue, 1) == [b"whole"]
            one.sendall(b"and ended\nx" + b"x" * 5000 + b"\nlast")
        assert receive_lines(queue, 2) == [b"begun and ended", b"last"]
        assert queue.lost == {"longer than max_line_bytes": 1}


def test_tcp_rejects_too_many_senders():
    with receiving("tcp://:0", replace(OPTIONS, max_connections=1)) as (address, queue):
        one = socket.create_connection((address.host, address.port))
        one.sendall(b"first\n")
        assert receive_lines(queue, 1) == [b"first"]
        with one, socket.create_connection((address.host, address.port)) as other:
            other.settimeout(PATIENCE_S)
            assert other.recv(1) == b""
        assert queue.lost == {"more senders than max_connections": 1}


def test_port_in_use_is_an_error():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        for kind in ("tcp", "zmq+pull"):
            with pytest.raises(StreamError, match=f"{port}"), receiving(f"{kind}://127.0.0.1:{port}"):
                pass


def test_lines_over_a_unix_socket(tmp_path: Path):
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as left_behind:
        left_behind.bind(str(path))
    with receiving(f"unix:{path}") as (_, queue):
        assert path.stat().st_mode & 0o077 == 0
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as sender:
            sender.connect(str(path))
            sender.sendall(b"one\ntwo\n")
        assert receive_lines(queue, 2) == [b"one", b"two"]
        with pytest.raises(StreamError, match="Cannot listen"), receiving(f"unix:{path}"):
            pass
    assert not path.exists()
    path.write_text("a file of somebody's")
    with pytest.raises(StreamError, match="Cannot listen"), receiving(f"unix:{path}"):
        pass
    assert path.read_text() == "a file of somebody's"


def test_zeromq_pushed():
    zmq = pytest.importorskip("zmq", reason="pyzmq is not installed (extra live)")
    with (
        receiving("zmq+pull://127.0.0.1:0") as (address, queue),
        zmq.Context() as context,
        context.socket(zmq.PUSH) as sender,
    ):
        sender.connect(f"tcp://127.0.0.1:{address.port}")
        sender.send(b"one")
        sender.send(b"two\nthree\n")
        assert receive_lines(queue, 3) == [b"one", b"two", b"three"]


def test_zeromq_published():
    zmq = pytest.importorskip("zmq", reason="pyzmq is not installed (extra live)")
    with zmq.Context() as context, context.socket(zmq.XPUB) as publisher:
        port = publisher.bind_to_random_port("tcp://127.0.0.1")
        with receiving(f"zmq+sub://127.0.0.1:{port}/pose") as (_, queue):
            assert publisher.poll(1000 * PATIENCE_S)
            assert publisher.recv() == b"\x01pose"
            publisher.send_multipart([b"other", b"not asked for"])
            publisher.send_multipart([b"pose.left", b"one"])
            assert receive_lines(queue, 1) == [b"one"]


class TinyNats(socketserver.StreamRequestHandler):
    """As much of a NATS server as one subscriber needs: the text protocol of NATS, INFO to MSG."""

    def handle(self) -> None:
        self.wfile.write(
            b'INFO {"server_id":"A","version":"2.10.0","proto":1,"max_payload":1048576,"headers":true}\r\n'
        )
        for line in self.rfile:
            word, *rest = line.split()
            if word == b"PING":
                self.wfile.write(b"PONG\r\n")
            elif word == b"SUB":
                subject, number = rest[0], rest[-1]
                for payload in (b"one", b"two\nthree"):
                    self.wfile.write(b"MSG %s %s %d\r\n%s\r\n" % (subject, number, len(payload), payload))


def test_nats_protocol():
    pytest.importorskip("nats", reason="nats-py is not installed (extra live)")
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), TinyNats) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        with receiving(f"nats://127.0.0.1:{server.server_address[1]}/pose") as (_, queue):
            assert receive_lines(queue, 3) == [b"one", b"two", b"three"]
        server.shutdown()


def test_nats_server():
    nats = pytest.importorskip("nats", reason="nats-py is not installed (extra live)")
    # Debian puts it where users do not look.
    binary = shutil.which("nats-server", path=f"{os.environ.get('PATH', '')}{os.pathsep}/usr/sbin")
    if binary is None:
        pytest.skip("there is no nats-server on this machine; its protocol is tested with a tiny one above")
    import asyncio

    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = subprocess.Popen([binary, "-a", "127.0.0.1", "-p", str(port)], stderr=subprocess.DEVNULL)

    async def publish() -> None:
        client = await nats.connect(f"nats://127.0.0.1:{port}")
        for _ in range(20):
            await client.publish("pose", b"one")
            await client.flush()
            await asyncio.sleep(0.05)
        await client.close()

    def is_listening() -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    try:
        until(is_listening)
        with receiving(f"nats://127.0.0.1:{port}/pose") as (_, queue):
            asyncio.run(publish())
            assert receive_lines(queue, 1)[0] == b"one"
    finally:
        server.terminate()
        server.wait()


def test_missing_nats_server_is_an_error():
    pytest.importorskip("nats", reason="nats-py is not installed (extra live)")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(StreamError, match="Is it running"), receiving(f"nats://127.0.0.1:{port}/pose"):
        pass
