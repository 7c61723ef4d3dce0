"""Receive lines from stdin and sockets in a thread; see :mod:`posefuse.live.brokers` for ZeroMQ and NATS."""

import contextlib
import os
import select
import selectors
import socket
import stat
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from posefuse.errors import PosefuseError, StreamError
from posefuse.live.addresses import Address
from posefuse.live.line_queue import LineQueue
from posefuse.live.lines import Sender
from posefuse.model.options.stream import StreamOptions

_BLOCK = 1 << 16
_POLL_S = 0.1
TOO_MANY_SENDERS = "more senders than max_connections"


class Source:
    """Receives lines until it is closed.

    Args:
        address: address to receive from.
        queue: queue to put lines into.
        options: options of the stream.
    """

    def __init__(self, address: Address, queue: LineQueue, options: StreamOptions) -> None:
        self.address, self.queue, self.options = address, queue, options
        self.stop = threading.Event()
        self._connections = 0
        self.limited = options.when_behind == "drop"
        self._thread = threading.Thread(target=self._receive, name=f"posefuse {address.kind}", daemon=True)

    def start(self) -> Address:
        """Start receiving, and return the address, with the port if the system chose it.

        Raises:
            StreamError: if it cannot listen on the address, or the address cannot be reached.
        """
        receive = {
            "stdin": self._stdin,
            "tcp": self._listen,
            "unix": self._listen,
            "zmq+pull": self._zeromq,
            "zmq+sub": self._zeromq,
            "nats": self._nats,
        }[self.address.kind]
        self._work = receive()
        self._thread.start()
        return self.address

    def close(self) -> None:
        """Stop receiving and wait for the thread."""
        self.stop.set()
        self.queue.close()
        if self._thread.is_alive():
            self._thread.join(5.0)

    def _receive(self) -> None:
        try:
            self._work()
            self.queue.close()
        except PosefuseError as error:
            self.queue.close(error)
        except Exception as error:
            self.queue.close(StreamError(f"{self.address}: receiving failed: {type(error).__name__}: {error}"))

    def _zeromq(self) -> Callable[[], None]:
        from posefuse.live.brokers import open_zeromq

        self.address, work = open_zeromq(self.address, self.queue, self.options, self.stop, self.limited)
        return work

    def _nats(self) -> Callable[[], None]:
        from posefuse.live.brokers import open_nats

        return open_nats(self.address, self.queue, self.options, self.stop, self.limited)

    def _stdin(self) -> Callable[[], None]:
        descriptor = sys.stdin.fileno()

        def work() -> None:
            sender = Sender(self.queue, self.options, limited=self.limited)
            while not self.stop.is_set():
                if select.select([descriptor], [], [], _POLL_S)[0]:
                    data = os.read(descriptor, _BLOCK)
                    if not data:
                        break
                    sender.feed(data)
            sender.end()

        return work

    def _listen(self) -> Callable[[], None]:
        listener = listen_unix(self.address) if self.address.kind == "unix" else listen_tcp(self.address)
        if self.address.kind == "tcp":
            self.address = replace(self.address, port=listener.getsockname()[1])

        def work() -> None:
            with listener, selectors.DefaultSelector() as selector:
                listener.setblocking(False)
                selector.register(listener, selectors.EVENT_READ, None)
                while not self.stop.is_set():
                    for key, _ in selector.select(_POLL_S):
                        if key.data is None:
                            self._accept(listener, selector)
                        else:
                            self._read(key, selector)
                for key in list(selector.get_map().values()):
                    if key.data is not None:
                        _disconnect(key, selector)
            if self.address.kind == "unix":
                Path(self.address.name).unlink(missing_ok=True)

        return work

    def _accept(self, listener: socket.socket, selector: selectors.BaseSelector) -> None:
        with contextlib.suppress(OSError):
            connection, peer = listener.accept()
            self._connections += 1
            name = f"{peer[0]}:{peer[1]}" if peer else f"connection {self._connections}"
            if len(selector.get_map()) > self.options.max_connections:
                self.queue.lose(TOO_MANY_SENDERS)
                connection.close()
                return
            connection.setblocking(False)
            sender = Sender(self.queue, self.options, limited=self.limited, name=name)
            selector.register(connection, selectors.EVENT_READ, sender)

    def _read(self, key: selectors.SelectorKey, selector: selectors.BaseSelector) -> None:
        connection: socket.socket = key.fileobj  # type: ignore[assignment]
        try:
            data = connection.recv(_BLOCK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            key.data.feed(data)
        else:
            _disconnect(key, selector)


def _disconnect(key: selectors.SelectorKey, selector: selectors.BaseSelector) -> None:
    key.data.end()
    selector.unregister(key.fileobj)
    key.fileobj.close()  # type: ignore[union-attr]


def listen_tcp(address: Address) -> socket.socket:
    """Return a listening TCP socket.

    Raises:
        StreamError: if it cannot listen on the address.
    """
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    try:
        return socket.create_server((address.host, address.port), family=family)
    except (OSError, OverflowError) as error:
        raise StreamError(f"Cannot listen on {address}: {error}. Choose another port, or 0 for a free one.") from None


def listen_unix(address: Address) -> socket.socket:
    """Return a listening UNIX socket that only the same user can connect to; an abandoned one is replaced.

    Raises:
        StreamError: if it cannot listen on the address.
    """
    path = Path(address.name)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        if path.exists() and stat.S_ISSOCK(path.stat().st_mode) and not _answers(path):
            path.unlink()
        listener.bind(str(path))
        path.chmod(0o600)
        listener.listen()
    except OSError as error:
        listener.close()
        raise StreamError(f"Cannot listen on {address}: {error.strerror or error}. Choose another path.") from None
    return listener


def _answers(path: Path) -> bool:
    """Return whether a process listens on a socket's file."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        try:
            other.connect(str(path))
        except OSError:
            return False
    return True
