"""Send lines through ZeroMQ and NATS; each message is one line without its line feed."""

import asyncio
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from posefuse.errors import StreamError
from posefuse.live.addresses import Address
from posefuse.live.brokers import connect_nats, import_nats, import_zeromq
from posefuse.live.outbox import FLUSH_S, NOT_TAKEN, Outbox, SinkCounts
from posefuse.model.options.stream import StreamOptions

_MAX_BUFFERED = 256
"""Maximum number of messages that ZeroMQ buffers per peer."""
_POLL_S = 0.1
_RETRY_S = 0.01
_LINGER_MS = 1000
_TOO_LARGE = "larger than the server accepts"


class BrokerSink:
    """Sends lines in a thread of its own.

    Args:
        address: where the lines go.
        options: options of the stream.
        send_all: sends the lines of the outbox until it is finished or the event is set.
    """

    def __init__(
        self,
        address: Address,
        options: StreamOptions,
        send_all: Callable[[Outbox, SinkCounts, threading.Event], None],
    ) -> None:
        self.address, self.counts = address, SinkCounts()
        self._outbox = Outbox(options.queue_lines, self.counts)
        self._give_up = threading.Event()
        self._failure = ""
        self._thread = threading.Thread(
            target=self._work, args=(send_all,), name=f"posefuse {address.kind} output", daemon=True
        )
        self._thread.start()

    def write(self, line: bytes) -> None:
        """Put a line into the queue."""
        if self._failure:
            self.counts.drop(self._failure)
        else:
            self._outbox.put(line)

    def close(self) -> None:
        """Send the waiting lines for a limited time and stop."""
        self._outbox.close()
        self._thread.join(FLUSH_S)
        self._give_up.set()
        self._thread.join(5.0)
        self._outbox.abandon(NOT_TAKEN)

    def _work(self, send_all: Callable[[Outbox, SinkCounts, threading.Event], None]) -> None:
        try:
            send_all(self._outbox, self.counts, self._give_up)
        except Exception as error:  # a network library can raise any exception; tracking continues
            self._failure = f"sending failed: {type(error).__name__}"
            self._outbox.abandon(self._failure)


def zeromq_sink(address: Address, options: StreamOptions) -> BrokerSink:
    """Bind a PUB socket, or connect a PUSH socket.

    Raises:
        StreamError: if pyzmq is not installed, or the address cannot be used.
    """
    zmq = import_zeromq(address)
    publishes = address.kind == "zmq+pub"
    context = zmq.Context()
    sender: Any = context.socket(zmq.PUB if publishes else zmq.PUSH)
    sender.setsockopt(zmq.SNDHWM, min(options.queue_lines, _MAX_BUFFERED))
    try:
        if publishes:
            # Without this option, lines for slow subscribers would be dropped without being counted.
            sender.setsockopt(zmq.XPUB_NODROP, 1)
            sender.bind(f"tcp://{address.host}:{address.port or '*'}")
            address = replace(address, port=int(sender.getsockopt(zmq.LAST_ENDPOINT).decode().rpartition(":")[2]))
        else:
            sender.connect(f"tcp://{address.host}:{address.port}")
    except zmq.ZMQError as error:
        context.destroy(linger=0)
        raise StreamError(f"Cannot open {address}: {error.strerror}.") from None
    topic = [address.name.encode()] if address.name else []

    def send(line: bytes, counts: SinkCounts, give_up: threading.Event) -> None:
        while True:
            try:
                sender.send_multipart([*topic, line.rstrip(b"\n")], zmq.NOBLOCK)
                counts.send()
                return
            except zmq.Again:
                if give_up.wait(_RETRY_S):
                    counts.drop(NOT_TAKEN)
                    return

    def send_all(outbox: Outbox, counts: SinkCounts, give_up: threading.Event) -> None:
        try:
            while not outbox.finished and not give_up.is_set():
                line = outbox.take(_POLL_S)
                if line is not None:
                    send(line, counts, give_up)
        finally:
            context.destroy(linger=_LINGER_MS)

    return BrokerSink(address, options, send_all)


def nats_sink(address: Address, options: StreamOptions) -> BrokerSink:
    """Publish to a subject, reconnecting when necessary; lines wait meanwhile.

    Raises:
        StreamError: if nats-py is not installed, or no server can be reached.
    """
    nats = import_nats(address)

    async def publish_all(outbox: Outbox, counts: SinkCounts, give_up: threading.Event) -> None:
        client = await connect_nats(nats, address)
        loop = asyncio.get_running_loop()
        while not outbox.finished and not give_up.is_set():
            line = await loop.run_in_executor(None, outbox.take, _POLL_S)
            while line is not None and not client.is_connected and not give_up.is_set():
                await asyncio.sleep(_RETRY_S)
            if line is None:
                continue
            if not client.is_connected:
                counts.drop(NOT_TAKEN)
                continue
            try:
                await client.publish(address.name, line.rstrip(b"\n"))
                counts.send()
            except nats.errors.MaxPayloadError:
                counts.drop(_TOO_LARGE)
        if client.is_connected:
            await client.flush(timeout=round(FLUSH_S))
        await client.close()

    return BrokerSink(address, options, lambda *arguments: asyncio.run(publish_all(*arguments)))
