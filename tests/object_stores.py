"""A local S3 server for tests, in a process of its own, and helpers for folders on it."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from posefuse.io.object_stores import list_files, read_stored, upload

_SERVER = """
import sys, threading, time
from moto.server import ThreadedMotoServer
server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
server.start()
print(*server.get_host_and_port(), flush=True)
sys.stdin.read()
"""
CREDENTIALS = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_DEFAULT_REGION": "us-east-1"}


@contextlib.contextmanager
def s3_server(log: Path) -> Iterator[str]:
    """Run a server and yield its address; a line of the log is a request."""
    with (
        log.open("wb") as lines,
        subprocess.Popen(
            [sys.executable, "-c", _SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=lines, text=True
        ) as process,
    ):
        assert process.stdout is not None
        assert process.stdin is not None
        host, port = process.stdout.readline().split()
        try:
            yield f"http://{host}:{port}"
        finally:
            process.stdin.close()


@contextlib.contextmanager
def environment(**values: str) -> Iterator[None]:
    """Set variables of this process and of those that it starts."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def make_bucket(name: str) -> str:
    """Create a bucket, and return its URL."""
    import fsspec

    fsspec.filesystem("s3").mkdir(name)
    return f"s3://{name}"


def upload_folder(folder: Path, url: str) -> str:
    """Copy a folder to a store, and return the URL of the copy."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    upload({f"{url}/{path.relative_to(folder).as_posix()}": path for path in files})
    return url


def contents(url: str, *, without: tuple[str, ...] = ("upload.json",)) -> dict[str, bytes | None]:
    """Return the content of each file in a folder on a store, by its name."""
    return {name: read_stored(f"{url}/{name}") for name in list_files(url) if name.rpartition("/")[2] not in without}


def local_contents(folder: Path) -> dict[str, bytes | None]:
    """Return the content of each file in a local folder, by its name."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
