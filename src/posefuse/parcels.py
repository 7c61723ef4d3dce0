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

from posefuse.pickled import pickled, total_bytes

_LEAST_BYTES = 1 << 20
"""Size from which arrays are sent in a file."""
_ALIGNED_BYTES = 64


@dataclass(frozen=True)
class _Parcel:
    """A pickle, and the arrays that it lacks: in a file, at these positions."""

    head: bytes
    file: Path
    spans: tuple[tuple[int, int], ...]

    def received(self) -> Any:
        """Return the value, and remove the file."""
        with self.file.open("rb") as file:
            content = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY))
        with contextlib.suppress(OSError):
            self.file.unlink()
        return pickle.loads(self.head, buffers=[content[start:stop] for start, stop in self.spans])


@dataclass(frozen=True)
class _Letter:
    """A pickle, and the arrays that it lacks."""

    head: bytes
    arrays: tuple[bytearray, ...]

    def received(self) -> Any:
        """Return the value."""
        return pickle.loads(self.head, buffers=self.arrays)


class Parcels:
    """A temporary folder for values on their way, created with the first file."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.gettempdir(), f"posefuse-{secrets.token_hex(8)}")

    def sent(self, value: Any) -> _Parcel | _Letter:
        """Return what to send instead of a value; its ``received()`` returns the value.

        Arrays that the receiver maps can be changed; the changes stay in its process. Arrays of a small value go with
        the pickle, also if the folder is full.
        """
        head, arrays = pickled(value)
        if total_bytes(arrays) >= _LEAST_BYTES:
            with contextlib.suppress(OSError):
                return _Parcel(head, *self._file_of(arrays))
        return _Letter(head, tuple(bytearray(array.raw()) for array in arrays))

    def remove(self) -> None:
        """Remove the folder, with what was not received."""
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
