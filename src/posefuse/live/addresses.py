"""Parse the address that a stream comes from."""

import ipaddress
from dataclasses import dataclass
from typing import Literal
from urllib.parse import unquote, urlsplit

from posefuse.errors import OptionsError, suggestion

Kind = Literal["stdin", "tcp", "unix", "zmq+pull", "zmq+sub", "nats"]
LOOPBACK = "127.0.0.1"
EXAMPLES = {
    "-": "stdin",
    "tcp://127.0.0.1:5570": "listens, lines",
    "unix:/tmp/posefuse.sock": "listens, lines",
    "zmq+pull://127.0.0.1:5570": "listens, PULL",
    "zmq+sub://host:5570": "connects, SUB",
    "nats://host:4222/subject": "connects",
}


@dataclass(frozen=True)
class Address:
    """The source of a stream.

    Attributes:
        kind: transport.
        host: host to listen on or to connect to.
        port: port to listen on or to connect to; 0 lets the system choose a port to listen on.
        name: path of a UNIX socket, NATS subject, or message prefix of a ZeroMQ publisher.
    """

    kind: Kind
    host: str = LOOPBACK
    port: int = 0
    name: str = ""

    @property
    def listens(self) -> bool:
        """Whether senders connect to this process."""
        return self.kind in ("tcp", "unix", "zmq+pull")

    @property
    def is_open(self) -> bool:
        """Whether it accepts connections from other machines."""
        return self.listens and self.kind != "unix" and not _is_loopback(self.host)

    def __str__(self) -> str:
        if self.kind == "stdin":
            return "stdin"
        if self.kind == "unix":
            return f"unix:{self.name}"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}://{host}:{self.port}" + (f"/{self.name}" if self.name else "")


def parse_address(text: str) -> Address:
    """Return the address that a text denotes.

    Raises:
        OptionsError: if the text is not an address, or a part is missing.
    """
    if text in ("-", "stdin"):
        return Address("stdin")
    if text.startswith("unix:"):
        path = text.removeprefix("unix:").removeprefix("//")
        if not path:
            raise OptionsError(
                "`input='unix:'`: the path of the socket is missing; expected an address such as unix:/tmp/p.sock."
            )
        return Address("unix", name=path)
    kinds: dict[str, Kind] = {"tcp": "tcp", "zmq+pull": "zmq+pull", "zmq+sub": "zmq+sub", "nats": "nats"}
    kind = text.partition("://")[0]
    if "://" not in text or kind not in kinds:
        listed = "".join(f"\n  {example}  ({meaning})" for example, meaning in EXAMPLES.items())
        near = suggestion(kind, kinds)
        meant = f" {near}" if "://" in text and near.startswith("Did") else ""
        raise OptionsError(f"`input`: {text!r} is not an address.{meant} Valid forms:{listed}")
    return _network(kinds[kind], text)


def _network(kind: Kind, text: str) -> Address:
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise OptionsError(f"`input={text!r}`: {error}.") from None
    if parts.username is not None or parts.query or parts.fragment:
        raise OptionsError(f"`input={text!r}`: an address must have a host, a port and optionally a name.")
    name = unquote(parts.path.removeprefix("/"))
    if kind == "nats":
        if not name or any(character.isspace() for character in name):
            raise OptionsError(f"`input={text!r}`: the subject is missing; expected nats://host:4222/subject.")
        port = port or 4222
    if port is None:
        meant = f"{kind}://{LOOPBACK}:{host}" if host and host.isdigit() else f"{kind}://{host or LOOPBACK}:5570"
        raise OptionsError(f"`input={text!r}`: the port is missing; expected {meant}.")
    if kind in ("tcp", "zmq+pull") and name:
        raise OptionsError(f"`input={text!r}`: {kind} takes no name after the port, got {name!r}.")
    return Address(kind, host or LOOPBACK, port, name)


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
