"""Where HDF5 files keep texts of any length, looked through before the library does.

The library follows sizes in a broken heap without end, and nothing stops it. Layout after the HDF5 File Format
Specification, "Disk Format: Level 1E - Global Heap": a collection is GCOL, version, its size, then objects (index,
references, size, content in steps of 8 bytes); index 0 is the free rest, and as long.
"""

import mmap
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from posefuse.errors import FileError

_HEAD, _STEP, _SIGNATURE = 16, 8, 8
_WINDOW = 1 << 24
_COLLECTION = re.compile(rb"GCOL\x01\x00\x00\x00")


def check_heaps(path: Path) -> None:
    """Look through every heap of texts of an HDF5 file.

    Raises:
        FileError: if objects do not fill the heap that holds them.
    """
    if path.stat().st_size == 0:
        return
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for start in _collections(file):
            if not _is_whole(content, start):
                raise FileError(
                    f"{path} is not a whole HDF5 file: its texts at byte {start} are broken. Was it cut short?"
                )


def _collections(file: BinaryIO) -> Iterator[int]:
    """Where collections begin. A map of a whole file would count as memory; windows of it do not."""
    before, kept = 0, b""
    while read := file.read(_WINDOW):
        window = kept + read
        yield from (before + match.start() for match in _COLLECTION.finditer(window))
        # A signature may lie across two windows; of one that lies in this, too little is left to be found again.
        kept = window[-(_SIGNATURE - 1) :]
        before += len(window) - len(kept)


def _is_whole(content: mmap.mmap, start: int) -> bool:
    """Whether a collection's objects lie in it, one behind the other."""
    if start + _HEAD > len(content):
        return False
    stop = start + struct.unpack_from("<Q", content, start + _STEP)[0]
    if stop > len(content):
        return False
    at = start + _HEAD
    while at + _HEAD <= stop:
        index, size = struct.unpack_from("<H", content, at)[0], struct.unpack_from("<Q", content, at + _STEP)[0]
        if index == 0:
            return size == stop - at
        at += _HEAD + -(-size // _STEP) * _STEP
    return at <= stop
