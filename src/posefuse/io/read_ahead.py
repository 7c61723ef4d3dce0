"""Many small files, read ahead of whoever makes sense of them: what a disk takes for each file is then no wait."""

import os
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from posefuse.errors import FileError

_READERS = 4
_AT_ONCE = 100
_AHEAD = 8
"""So many lots of so many files are in memory; more readers do not make it faster."""


def contents(folder: Path, names: Sequence[str]) -> Generator[bytes]:
    """What is in files of a folder, one after another, in the order of the names.

    Raises:
        FileError: if a file cannot be read, when its turn has come.
    """
    lots = [[os.path.join(folder, name) for name in names[i : i + _AT_ONCE]] for i in range(0, len(names), _AT_ONCE)]
    readers = ThreadPoolExecutor(_READERS, "posefuse-read")
    pending: deque[Future[list[bytes | FileError]]] = deque()
    try:
        for lot in lots:
            pending.append(readers.submit(_read, lot))
            if len(pending) == _AHEAD:
                yield from _each(pending.popleft())
        while pending:
            yield from _each(pending.popleft())
    finally:
        readers.shutdown(cancel_futures=True)


def _each(lot: "Future[list[bytes | FileError]]") -> Iterator[bytes]:
    for content in lot.result():
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
