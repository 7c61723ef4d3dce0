"""Addresses of streams."""

import pytest

from posefuse.errors import OptionsError
from posefuse.live.addresses import OUTPUT, parse_address


@pytest.mark.parametrize(
    ("text", "shown", "is_open"),
    [
        ("-", "stdin", False),
        ("tcp://:5570", "tcp://127.0.0.1:5570", False),
        ("tcp://localhost:0", "tcp://localhost:0", False),
        ("tcp://0.0.0.0:5570", "tcp://0.0.0.0:5570", True),
        ("tcp://[::1]:5570", "tcp://[::1]:5570", False),
        ("tcp://[::]:5570", "tcp://[::]:5570", True),
        ("zmq+pull://somewhere:5570", "zmq+pull://somewhere:5570", True),
        ("zmq+sub://somewhere:5570/pose", "zmq+sub://somewhere:5570/pose", False),
        ("nats://somewhere/pose.left", "nats://somewhere:4222/pose.left", False),
        ("unix:/tmp/s", "unix:/tmp/s", False),
        ("unix:///tmp/s", "unix:/tmp/s", False),
    ],
)
def test_addresses(text, shown, is_open):
    address = parse_address(text)
    assert (str(address), address.is_open) == (shown, is_open)


@pytest.mark.parametrize(
    ("text", "shown", "is_open"),
    [
        ("-", "stdout", False),
        ("tcp://0.0.0.0:0", "tcp://0.0.0.0:0", True),
        ("zmq+pub://0.0.0.0:5571/a", "zmq+pub://0.0.0.0:5571/a", True),
        ("zmq+push://somewhere:5571", "zmq+push://somewhere:5571", False),
        ("nats://somewhere/pose", "nats://somewhere:4222/pose", False),
    ],
)
def test_output_addresses(text, shown, is_open):
    address = parse_address(text, OUTPUT)
    assert (str(address), address.is_open) == (shown, is_open)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("zmq+pull://:1", "`output`: .* Did you mean 'zmq+pub'"),
        ("nats://x/a.*", "select several"),
        ("zmq+push://:1/x", "takes no"),
    ],
)
def test_invalid_output_addresses(text, message):
    with pytest.raises(OptionsError, match=message.replace("+", r"\+")):
        parse_address(text, OUTPUT)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("5570", "Valid forms"),
        ("tpc://x:1", "Did you mean 'tcp'?"),
        ("udp://:1", "unix:/tmp/posefuse.sock"),
        ("tcp://x", "the port is missing"),
        ("tcp://5570", "expected tcp://127.0.0.1:5570"),
        ("tcp://x:99999", "Port out of range"),
        ("tcp://x:1/y", "takes no name"),
        ("nats://x", "the subject is missing"),
        ("unix:", "the path of the socket is missing"),
        ("tcp://me:secret@x:1", "optionally a name"),
    ],
)
def test_invalid_addresses(text, message):
    with pytest.raises(OptionsError, match=message.replace("?", r"\?")):
        parse_address(text)
