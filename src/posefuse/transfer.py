"""Send values from one process to another on this machine, with large arrays in files that the receiver maps.

A pipe would hold each array several times: pickled and being written by one process, being read and restored by the
other. A mapped array occupies memory once, where it is used, and the operating system may drop what it can read again.
"""

import contextlib
import mmap
import os
import pickle
import secrets
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from posefuse.pickled import pickled

_LEAST_BYTES = 1 << 20
"""Size from which arrays are sent in a file."""
_ALIGNED_BYTES = 64


@dataclass(frozen=True)
class _ArraysInFile:
    """A pickle, and the arrays that it lacks: in a file, at these positions."""

    head: bytes
    file: Path
    spans: tuple[tuple[int, int], ...]

    def unpack(self) -> Any:
        """Return the value, and remove the file."""
        with self.file.open("rb") as file:
            content = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY))
        with contextlib.suppress(OSError):
            self.file.unlink()
        return pickle.loads(self.head, buffers=[content[start:stop] for start, stop in self.spans])


@dataclass(frozen=True)
class _ArraysInMessage:
    """A pickle, and the arrays that it lacks."""

    head: bytes
    arrays: tuple[bytearray, ...]

    def unpack(self) -> Any:
        """Return the value."""
        return pickle.loads(self.head, buffers=self.arrays)


class Transfer:
    """A temporary folder of arrays that were sent and not received, created with the first file."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.gettempdir(), f"posefuse-{secrets.token_hex(8)}")

    def pack(self, value: Any) -> _ArraysInFile | _ArraysInMessage:
        """Return a message whose ``unpack()`` returns the value in another process.

        Large arrays are in a file if it can be written, others in the message. The receiver may change them; changes
        stay in its process.
        """
        head, arrays = pickled(value)
        if sum(array.raw().nbytes for array in arrays) >= _LEAST_BYTES:
            with contextlib.suppress(OSError):
                return _ArraysInFile(head, *self._file_of(arrays))
        return _ArraysInMessage(head, tuple(bytearray(array.raw()) for array in arrays))

    def remove(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _file_of(self, arrays: Sequence[pickle.PickleBuffer]) -> tuple[Path, tuple[tuple[int, int], ...]]:
        """Return a file of arrays, and where each of them is.

        Raises:
            OSError: if it cannot be written.
        """
        self.folder.mkdir(mode=0o700, exist_ok=True)
        number, name = tempfile.mkstemp(dir=self.folder)
        spans = []
        try:
            with os.fdopen(number, "wb") as file:
                for array in arrays:
                    start = file.tell()
                    file.write(array.raw())
                    spans.append((start, file.tell()))
                    file.write(bytes(-file.tell() % _ALIGNED_BYTES))
        except OSError:
            with contextlib.suppress(OSError):
                os.unlink(name)
            raise
        return Path(name), tuple(spans)
