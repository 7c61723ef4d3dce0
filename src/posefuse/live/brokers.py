"""Receive lines from ZeroMQ and NATS; each message holds one or more lines."""

import asyncio
import socket
import threading
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

from posefuse.errors import StreamError
from posefuse.live.addresses import Address
from posefuse.live.line_queue import LineQueue
from posefuse.live.lines import Sender
from posefuse.model.options.stream import StreamOptions

_POLL_MS = 100
_MAX_BUFFERED = 256
"""Maximum number of messages that ZeroMQ buffers per peer, each of up to ``max_line_bytes``."""
_CONNECT_S = 5.0
_EXTRA = "Install it: pip install 'posefuse[live]'."


def open_zeromq(
    address: Address, queue: LineQueue, options: StreamOptions, stop: threading.Event, limited: bool
) -> tuple[Address, Callable[[], None]]:
    """Bind a PULL socket, or connect a SUB socket.

    Returns:
        The address, with the port if the system chose it, and a function that receives until ``stop`` is set.

    Raises:
        StreamError: if pyzmq is not installed, or the socket cannot be bound.
    """
    zmq = import_zeromq(address)
    pulls = address.kind == "zmq+pull"
    context = zmq.Context()
    receiver: Any = context.socket(zmq.PULL if pulls else zmq.SUB)
    receiver.setsockopt(zmq.LINGER, 0)
    receiver.setsockopt(zmq.MAXMSGSIZE, options.max_line_bytes)
    receiver.setsockopt(zmq.RCVHWM, min(options.queue_messages, _MAX_BUFFERED))
    try:
        if pulls:
            receiver.bind(f"tcp://{address.host}:{address.port or '*'}")
            address = replace(address, port=int(receiver.getsockopt(zmq.LAST_ENDPOINT).decode().rpartition(":")[2]))
        else:
            receiver.setsockopt(zmq.SUBSCRIBE, address.name.encode())
            receiver.connect(f"tcp://{address.host}:{address.port}")
    except zmq.ZMQError as error:
        context.destroy(linger=0)
        raise StreamError(f"Cannot open {address}: {error.strerror}.") from None

    def work() -> None:
        sender = Sender(queue, options, limited=limited)
        try:
            while not stop.is_set():
                if receiver.poll(_POLL_MS):
                    # A publisher may send a topic before the message.
                    sender.feed(receiver.recv_multipart()[-1] + b"\n")
        finally:
            context.destroy(linger=0)

    return address, work


def open_nats(
    address: Address, queue: LineQueue, options: StreamOptions, stop: threading.Event, limited: bool
) -> Callable[[], None]:
    """Return a function that subscribes to a subject and receives until ``stop`` is set, reconnecting when necessary.

    Raises:
        StreamError: if nats-py is not installed, or no server can be reached.
    """
    nats = import_nats(address)

    async def receive() -> None:
        sender = Sender(queue, options, limited=limited)

        async def take(message: Any) -> None:
            sender.feed(message.data + b"\n")

        client = await connect_nats(nats, address)
        await client.subscribe(address.name, cb=take, pending_msgs_limit=options.queue_messages)
        while not stop.is_set():
            await asyncio.sleep(_POLL_MS / 1000.0)
        await client.close()

    return lambda: asyncio.run(receive())


def import_zeromq(address: Address) -> ModuleType:
    """Return pyzmq.

    Raises:
        StreamError: if it is not installed.
    """
    try:
        import zmq
    except ImportError:
        raise StreamError(f"{address} needs pyzmq, which is not installed. {_EXTRA}") from None
    return zmq


def import_nats(address: Address) -> ModuleType:
    """Return nats-py after checking that a server can be reached.

    Raises:
        StreamError: if it is not installed, or no server can be reached.
    """
    try:
        import nats
    except ImportError:
        raise StreamError(f"{address} needs nats-py, which is not installed. {_EXTRA}") from None
    try:
        socket.create_connection((address.host, address.port), _CONNECT_S).close()
    except OSError as error:
        raise StreamError(f"Cannot reach a NATS server at {_server(address)}: {error}. Is it running?") from None
    return nats


def _server(address: Address) -> str:
    return f"nats://{address.host}:{address.port}"


async def connect_nats(nats: Any, address: Address) -> Any:
    """Return a client that reconnects without limit after the first connection.

    Raises:
        StreamError: if no server answers.
    """

    async def ignore(_: Exception) -> None:
        """Do nothing: the client reconnects, and lost messages are counted as missing."""

    connecting = nats.connect(_server(address), connect_timeout=_CONNECT_S, max_reconnect_attempts=-1, error_cb=ignore)
    try:
        return await asyncio.wait_for(connecting, 2.0 * _CONNECT_S)
    except Exception as error:
        why = str(error) or type(error).__name__
        raise StreamError(f"No NATS server answers at {_server(address)}: {why}. Check the address.") from None
