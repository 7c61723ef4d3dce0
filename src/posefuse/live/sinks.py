"""Send the output lines of a stream over sockets, ZeroMQ and NATS; one record per transport.

Writing never waits: every consumer has a bounded queue and a thread of its own, so a slow or lost consumer does not
delay tracking. Dropped lines are counted. See :mod:`posefuse.live.broker_sinks` for ZeroMQ and NATS.
"""

import contextlib
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from posefuse.live.addresses import Address, Kind
from posefuse.live.outbox import FLUSH_S, NOT_TAKEN, Outbox, SinkCounts
from posefuse.live.sources import listen_tcp, listen_unix
from posefuse.model.options.stream import StreamOptions

_POLL_S = 0.1
NO_CONSUMER = "no consumer connected"
DISCONNECTED = "consumer disconnected"


class Sink(Protocol):
    """A destination of output lines.

    Attributes:
        address: where the lines go, with the port if the system chose it.
        counts: what was sent and dropped.
    """

    address: Address
    counts: SinkCounts

    def write(self, line: bytes) -> None:
        """Accept a line, terminated by a line feed, without waiting."""
        ...

    def close(self) -> None:
        """Send the waiting lines, for a limited time, and stop."""
        ...


@dataclass(frozen=True)
class SinkTransport:
    """A transport of output lines.

    Attributes:
        kind: kind of its addresses.
        open: open a sink. Raises a StreamError if the address cannot be used.
    """

    kind: Kind
    open: Callable[[Address, StreamOptions], Sink]


class ListeningSink:
    """Sends every line to all consumers that are connected to a TCP or UNIX socket.

    A consumer first receives the first line of the stream, then all lines written after it connected.

    Raises:
        StreamError: if it cannot listen on the address.
    """

    def __init__(self, address: Address, options: StreamOptions) -> None:
        self.counts, self._options = SinkCounts(), options
        self._listener = listen_unix(address) if address.kind == "unix" else listen_tcp(address)
        if address.kind == "tcp":
            address = replace(address, port=self._listener.getsockname()[1])
        self.address = address
        self._first: bytes | None = None
        self._consumers: dict[threading.Thread, tuple[socket.socket, Outbox]] = {}
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._acceptor = threading.Thread(target=self._accept, name=f"posefuse {address.kind} output", daemon=True)
        self._acceptor.start()

    def write(self, line: bytes) -> None:
        """Put a line into the queues of all consumers."""
        with self._lock:
            is_first, self._first = self._first is None, self._first or line
            outboxes = [outbox for _, outbox in self._consumers.values()]
            for outbox in outboxes:
                outbox.put(line)
        if not outboxes and not is_first:
            self.counts.drop(NO_CONSUMER)

    def close(self) -> None:
        """Send the waiting lines for a limited time and disconnect all consumers."""
        self._stop.set()
        self._acceptor.join(5.0)
        with self._lock:
            consumers = dict(self._consumers)
        for _, outbox in consumers.values():
            outbox.close()
        end_s = time.monotonic() + FLUSH_S
        for thread, (connection, outbox) in consumers.items():
            thread.join(max(0.0, end_s - time.monotonic()))
            if thread.is_alive():
                outbox.abandon(NOT_TAKEN)
                with contextlib.suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)
                thread.join(5.0)
        if self.address.kind == "unix":
            Path(self.address.name).unlink(missing_ok=True)

    def _accept(self) -> None:
        with self._listener:
            self._listener.settimeout(_POLL_S)
            while not self._stop.is_set():
                try:
                    connection, _ = self._listener.accept()
                except (TimeoutError, OSError):
                    continue
                self._add(connection)

    def _add(self, connection: socket.socket) -> None:
        outbox = Outbox(self._options.queue_lines, self.counts)
        thread = threading.Thread(target=self._serve, args=(connection, outbox), daemon=True)
        with self._lock:
            if len(self._consumers) >= self._options.max_connections:
                connection.close()
                return
            connection.settimeout(None)
            if self._first is not None:
                outbox.put(self._first)
            self._consumers[thread] = (connection, outbox)
        thread.start()

    def _serve(self, connection: socket.socket, outbox: Outbox) -> None:
        with connection:
            while not outbox.finished:
                line = outbox.take(_POLL_S)
                if line is None:
                    continue
                try:
                    connection.sendall(line)
                except OSError:
                    self.counts.drop(NOT_TAKEN if self._stop.is_set() else DISCONNECTED)
                    outbox.abandon(DISCONNECTED)
                    break
                self.counts.send()
        with self._lock:
            self._consumers.pop(threading.current_thread(), None)


def _zeromq(address: Address, options: StreamOptions) -> Sink:
    from posefuse.live.broker_sinks import zeromq_sink

    return zeromq_sink(address, options)


def _nats(address: Address, options: StreamOptions) -> Sink:
    from posefuse.live.broker_sinks import nats_sink

    return nats_sink(address, options)


TRANSPORTS = (
    SinkTransport("tcp", ListeningSink),
    SinkTransport("unix", ListeningSink),
    SinkTransport("zmq+push", _zeromq),
    SinkTransport("zmq+pub", _zeromq),
    SinkTransport("nats", _nats),
)


def open_sink(address: Address, options: StreamOptions) -> Sink:
    """Open the sink of an address.

    Raises:
        StreamError: if a package is not installed, or the address cannot be used.
    """
    (transport,) = (each for each in TRANSPORTS if each.kind == address.kind)
    return transport.open(address, options)
