"""Parse the addresses that a stream comes from and goes to."""

import ipaddress
from dataclasses import dataclass
from typing import Literal
from urllib.parse import unquote, urlsplit

from posefuse.errors import OptionsError, suggestion

Kind = Literal["stdin", "stdout", "tcp", "unix", "zmq+pull", "zmq+sub", "zmq+push", "zmq+pub", "nats"]
LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class Flow:
    """Addresses that an argument accepts.

    Attributes:
        argument: name of the argument, for messages.
        standard: kind of the address ``-``.
        kinds: kinds of network addresses.
        examples: example of each form to its meaning.
    """

    argument: str
    standard: Kind
    kinds: tuple[Kind, ...]
    examples: dict[str, str]


INPUT = Flow(
    "input",
    "stdin",
    ("tcp", "zmq+pull", "zmq+sub", "nats"),
    {
        "-": "stdin",
        "tcp://127.0.0.1:5570": "listens, lines",
        "unix:/tmp/posefuse.sock": "listens, lines",
        "zmq+pull://127.0.0.1:5570": "listens, PULL",
        "zmq+sub://host:5570": "connects, SUB",
        "nats://host:4222/subject": "connects",
    },
)
OUTPUT = Flow(
    "output",
    "stdout",
    ("tcp", "zmq+push", "zmq+pub", "nats"),
    {
        "stdout": "the default",
        "tcp://127.0.0.1:5571": "listens, lines",
        "unix:/tmp/posefuse_out.sock": "listens, lines",
        "zmq+push://host:5571": "connects, PUSH",
        "zmq+pub://127.0.0.1:5571/topic": "listens, PUB",
        "nats://host:4222/subject": "connects",
    },
)


@dataclass(frozen=True)
class Address:
    """The source or destination of a stream.

    Attributes:
        kind: transport.
        host: host to listen on or to connect to.
        port: port to listen on or to connect to; 0 lets the system choose a port to listen on.
        name: path of a UNIX socket, NATS subject, or message prefix or topic of a ZeroMQ publisher.
    """

    kind: Kind
    host: str = LOOPBACK
    port: int = 0
    name: str = ""

    @property
    def listens(self) -> bool:
        """Whether others connect to this process."""
        return self.kind in ("tcp", "unix", "zmq+pull", "zmq+pub")

    @property
    def is_open(self) -> bool:
        """Whether it accepts connections from other machines."""
        return self.listens and self.kind != "unix" and not _is_loopback(self.host)

    def __str__(self) -> str:
        if self.kind in ("stdin", "stdout"):
            return self.kind
        if self.kind == "unix":
            return f"unix:{self.name}"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}://{host}:{self.port}" + (f"/{self.name}" if self.name else "")


def parse_address(text: str, flow: Flow = INPUT) -> Address:
    """Return the address that a text denotes.

    Args:
        text: the address as written.
        flow: the accepted forms.

    Raises:
        OptionsError: if the text is not an address, or a part is missing.
    """
    if text in ("-", flow.standard):
        return Address(flow.standard)
    if text.startswith("unix:"):
        path = text.removeprefix("unix:").removeprefix("//")
        if not path:
            raise OptionsError(
                f"`{flow.argument}='unix:'`: the path of the socket is missing; expected an address such as "
                "unix:/tmp/p.sock."
            )
        return Address("unix", name=path)
    kinds: dict[str, Kind] = {kind: kind for kind in flow.kinds}
    kind = text.partition("://")[0]
    if "://" not in text or kind not in kinds:
        listed = "".join(f"\n  {example}  ({meaning})" for example, meaning in flow.examples.items())
        near = suggestion(kind, kinds)
        meant = f" {near}" if "://" in text and near.startswith("Did") else ""
        raise OptionsError(f"`{flow.argument}`: {text!r} is not an address.{meant} Valid forms:{listed}")
    return _network(kinds[kind], text, flow)


def _network(kind: Kind, text: str, flow: Flow) -> Address:
    given = f"`{flow.argument}={text!r}`"
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise OptionsError(f"{given}: {error}.") from None
    if parts.username is not None or parts.query or parts.fragment:
        raise OptionsError(f"{given}: an address must have a host, a port and optionally a name.")
    name = unquote(parts.path.removeprefix("/"))
    if kind == "nats":
        if not name or any(character.isspace() for character in name):
            raise OptionsError(f"{given}: the subject is missing; expected nats://host:4222/subject.")
        if flow is OUTPUT and set(name) & set("*>"):
            raise OptionsError(f"{given}: lines are published to one subject; * and > select several.")
        port = port or 4222
    if port is None:
        meant = f"{kind}://{LOOPBACK}:{host}" if host and host.isdigit() else f"{kind}://{host or LOOPBACK}:5570"
        raise OptionsError(f"{given}: the port is missing; expected {meant}.")
    if kind in ("tcp", "zmq+pull", "zmq+push") and name:
        raise OptionsError(f"{given}: {kind} takes no name after the port, got {name!r}.")
    return Address(kind, host or LOOPBACK, port, name)


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
