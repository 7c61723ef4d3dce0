"""HDF5 files of anybody's, looked at before anything in them is read.

A file of a few bytes may announce arrays of any size, pack zeros in zeros, or keep its numbers in other files of the
computer that reads it; and the library follows broken heaps of texts without end.
"""

import contextlib
import math
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py

from posefuse.errors import FileError
from posefuse.io.files import most_unfolded, must_unfold, reading
from posefuse.io.hdf5_heaps import check_heaps

_DEFLATE = 1
_MOST_DEFLATED = 1032
"""Deflate makes at most so much of a byte. The other two are held to their chunk, or make less."""
_UNPACKS = {_DEFLATE: "deflate", 4: "szip", 32000: "lzf"}
"""Filters that make more of what they are given: the numbers by which HDF5 knows them."""


@contextlib.contextmanager
def open_hdf5(path: Path, what: str) -> Iterator[h5py.File]:
    """Open a file to read arrays of it whole.

    Args:
        path: of the file.
        what: it should be, for messages.

    Raises:
        FileError: if the file, or what is done with it within, is broken; or if it is a bomb.
    """
    check_heaps(path)
    with reading(path, what), h5py.File(path, "r") as file:
        must_be_plain(path, file, _whole_bytes)
        yield file


def check_hdf5(path: Path, what: str) -> None:
    """Look at a file that another library reads whole.

    Raises:
        FileError: if it is broken, or a bomb.
    """
    with open_hdf5(path, what):
        pass


def check_ranged(path: Path, what: str) -> None:
    """Look at a file whose long arrays, which are those of three axes and more, are read by ranges.

    Raises:
        FileError: if it is broken, or a bomb.
    """
    check_heaps(path)
    with reading(path, what), h5py.File(path, "r") as file:
        must_be_plain(path, file, _ranged_bytes)


def must_be_plain(path: Path, file: h5py.File, size_of: Callable[[h5py.Dataset], int]) -> None:
    """Refuse what is packed in itself, kept elsewhere, or enormous for the size of its file.

    Args:
        path: of the file.
        file: the same, open.
        size_of: bytes that reading from an array takes at once.

    Raises:
        FileError: if there is such a thing in it.
    """
    total = 0

    def look(name: str, item: Any) -> None:
        nonlocal total
        if isinstance(item, h5py.Dataset):
            _must_be_here(path, name, item)
            _must_fill_chunks(path, name, item)
            total += size_of(item)

    def elsewhere(name: str, link: Any) -> tuple[str, str] | None:
        return (name, link.filename) if isinstance(link, h5py.ExternalLink) else None

    # An error within would be lost: the library goes on.
    outside = file.visititems_links(elsewhere)
    if outside is not None:
        raise FileError(f"{path}: {outside[0]} leads to another file, {outside[1][:60]!r}; it is not read.")
    file.visititems(look)
    must_unfold(path, total)


def _must_be_here(path: Path, name: str, data: h5py.Dataset) -> None:
    made = data.id.get_create_plist()
    if made.get_external_count() or data.is_virtual:
        raise FileError(f"{path}: the numbers of {name} are in another file; it is not read.")
    packed = [_UNPACKS[number] for i in range(made.get_nfilters()) if (number := made.get_filter(i)[0]) in _UNPACKS]
    if len(packed) > 1:
        raise FileError(f"{path}: {name} is packed {len(packed)} times ({', '.join(packed)}); it is not read.")


def _must_fill_chunks(path: Path, name: str, data: h5py.Dataset) -> None:
    """Refuse deflated chunks that hold more than a chunk: the library unpacks all of it before it compares.

    Only those are looked into that could hold more than a file may unfold to: a few of any file.
    """
    made = data.id.get_create_plist()
    if data.chunks is None or _DEFLATE not in [made.get_filter(i)[0] for i in range(made.get_nfilters())]:
        return
    harmless = most_unfolded(path) // _MOST_DEFLATED
    if data.id.get_storage_size() <= harmless:
        return
    found: list[tuple[int, ...]] = []
    data.id.chunk_iter(lambda chunk: found.append(chunk.chunk_offset) if chunk.size > harmless else None)
    room = math.prod(data.chunks) * data.dtype.itemsize + _CHECKSUM_BYTES
    for place in found:
        _, content = data.id.read_direct_chunk(place)
        if len(zlib.decompressobj().decompress(content, room + 1)) > room:
            raise FileError(f"{path}: a chunk of {name} at {place} holds more than {room} bytes; it is not read.")


def _whole_bytes(data: h5py.Dataset) -> int:
    return math.prod(data.shape or ()) * data.dtype.itemsize


def _ranged_bytes(data: h5py.Dataset) -> int:
    if len(data.shape or ()) < _LONG_AXES:
        return _whole_bytes(data)
    return math.prod(data.chunks) * data.dtype.itemsize if data.chunks else 0


_LONG_AXES = 3
_CHECKSUM_BYTES = 4
