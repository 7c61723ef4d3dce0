"""Check of the global heaps of HDF5 files, which hold variable-length strings.

h5py does not return from reading a heap whose object sizes are broken, and cannot be interrupted then;
``test_h5py_never_returns_from_a_broken_heap`` holds such a file. Layout: HDF5 File Format Specification, "Disk Format:
Level 1E - Global Heap". A collection is GCOL, version, its size, then objects (index, references, size, content padded
to 8 bytes). The object with index 0 is the free space, whose size includes its header.
"""

import mmap
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from posefuse.errors import FileError

_HEADER_BYTES, _ALIGNMENT_BYTES, _SIGNATURE_BYTES = 16, 8, 8
_WINDOW_BYTES = 1 << 24
_COLLECTION = re.compile(rb"GCOL\x01\x00\x00\x00")


def check_heaps(path: Path) -> None:
    """Check every global heap of an HDF5 file.

    Raises:
        FileError: If the objects of a heap do not fill it.
    """
    if path.stat().st_size == 0:
        return
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for start in _collections(file):
            if not _is_whole(content, start):
                raise FileError(
                    f"{path} is not a complete HDF5 file: its strings at byte {start} are corrupt. Is the file "
                    "truncated?"
                )


def _collections(file: BinaryIO) -> Iterator[int]:
    """Yield the offsets of the collections, found window by window: a map of the whole file would count as memory."""
    before, overlap = 0, b""
    while read := file.read(_WINDOW_BYTES):
        window = overlap + read
        yield from (before + match.start() for match in _COLLECTION.finditer(window))
        # A signature may span two windows. The overlap is too short to contain a complete one, found already.
        overlap = window[-(_SIGNATURE_BYTES - 1) :]
        before += len(window) - len(overlap)


def _is_whole(content: mmap.mmap, start: int) -> bool:
    """Return whether the objects of a collection fill it one after another."""
    if start + _HEADER_BYTES > len(content):
        return False
    stop = start + struct.unpack_from("<Q", content, start + 8)[0]
    if stop > len(content):
        return False
    at = start + _HEADER_BYTES
    while at + _HEADER_BYTES <= stop:
        index, size = struct.unpack_from("<H", content, at)[0], struct.unpack_from("<Q", content, at + 8)[0]
        if index == 0:
            return size == stop - at
        at += _HEADER_BYTES + -(-size // _ALIGNMENT_BYTES) * _ALIGNMENT_BYTES
    return at <= stop
