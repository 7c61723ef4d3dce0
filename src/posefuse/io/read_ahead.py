"""Read-ahead in threads, of many small files, which hides the latency of the disk from the parser, or of any items."""

import os
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from posefuse.errors import FileError

Item = TypeVar("Item")

_THREADS = 4
_BATCH_FILES = 100
_MAX_BATCHES = 8
"""Number of batches held in memory. More threads are not faster."""


def read_ahead(items: Iterator[Item], most: int) -> Generator[Item]:
    """Yield items, of which the next ones, ``most`` at a time, are made in another thread; none of them is None."""
    thread = ThreadPoolExecutor(1, "posefuse-read")
    pending: deque[Future[Item | None]] = deque(thread.submit(next, items, None) for _ in range(most))
    try:
        while (item := pending.popleft().result()) is not None:
            pending.append(thread.submit(next, items, None))
            yield item
    finally:
        thread.shutdown(cancel_futures=True)


def contents(folder: Path, names: Sequence[str]) -> Generator[bytes]:
    """Yield the content of files in a folder, in the order of the names.

    Raises:
        FileError: If a file cannot be read, when it is next in order.
    """
    starts = range(0, len(names), _BATCH_FILES)
    batches = [[os.path.join(folder, name) for name in names[start : start + _BATCH_FILES]] for start in starts]
    threads = ThreadPoolExecutor(_THREADS, "posefuse-read")
    pending: deque[Future[list[bytes | FileError]]] = deque()
    try:
        for batch in batches:
            pending.append(threads.submit(_read, batch))
            if len(pending) == _MAX_BATCHES:
                yield from _each(pending.popleft())
        while pending:
            yield from _each(pending.popleft())
    finally:
        threads.shutdown(cancel_futures=True)


def _each(batch: "Future[list[bytes | FileError]]") -> Iterator[bytes]:
    for content in batch.result():
        if isinstance(content, FileError):
            raise content
        yield content


def _read(files: Sequence[str]) -> list[bytes | FileError]:
    return [_read_one(file) for file in files]


def _read_one(file: str) -> bytes | FileError:
    try:
        with open(file, "rb", buffering=0) as content:
            return content.read()
    except OSError as error:
        return FileError(f"{file} cannot be read: {error.strerror}.")
