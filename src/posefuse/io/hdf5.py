"""Checks of untrusted HDF5 files before any data is read.

A file of a few bytes can declare arrays of any size, nest compression filters, or refer to other files on the reading
computer. The HDF5 library also loops forever on some broken global heaps.
"""

import contextlib
import math
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py

from posefuse.errors import FileError
from posefuse.io.files import check_unpacked_size, max_unpacked_bytes, reading
from posefuse.io.hdf5_heaps import check_heaps

_DEFLATE = 1
_MAX_DEFLATE_RATIO = 1032
"""Largest expansion by deflate. The other filters expand less or at most to one chunk."""
_COMPRESSION_FILTERS = {_DEFLATE: "deflate", 4: "szip", 32000: "lzf"}
"""HDF5 numbers of the compression filters."""
_RANGED_AXES = 3
"""Arrays with at least this many axes are read by ranges."""
_CHECKSUM_BYTES = 4


@contextlib.contextmanager
def open_hdf5(path: Path, what: str) -> Iterator[h5py.File]:
    """Open a file whose arrays are read completely.

    Args:
        path: The file.
        what: Kind of file, for messages.

    Raises:
        FileError: If the file is broken, refers to other files, is a decompression bomb, or the block fails.
    """
    check_heaps(path)
    with reading(path, what), h5py.File(path, "r") as file:
        check_storage(path, file, _all_bytes)
        yield file


def check_hdf5(path: Path, what: str) -> None:
    """Check a file that another library reads completely.

    Raises:
        FileError: If the file is broken, refers to other files, or is a decompression bomb.
    """
    with open_hdf5(path, what):
        pass


def check_ranged(path: Path, what: str) -> None:
    """Check a file whose arrays with three or more axes are read by ranges.

    Raises:
        FileError: If the file is broken, refers to other files, or is a decompression bomb.
    """
    check_heaps(path)
    with reading(path, what), h5py.File(path, "r") as file:
        check_storage(path, file, _range_bytes)


def check_storage(path: Path, file: h5py.File, size_of: Callable[[h5py.Dataset], int]) -> None:
    """Refuse nested compression, data stored in other files, and arrays that are too large for the file.

    Args:
        path: The file.
        file: The same file, open.
        size_of: Function that returns the number of bytes that one read of an array takes.

    Raises:
        FileError: If the file contains any of these.
    """
    total = 0

    def check(name: str, item: Any) -> None:
        nonlocal total
        if isinstance(item, h5py.Dataset):
            _check_is_internal(path, name, item)
            _check_chunk_sizes(path, name, item)
            total += size_of(item)

    def external_link(name: str, link: Any) -> tuple[str, str] | None:
        return (name, link.filename) if isinstance(link, h5py.ExternalLink) else None

    # visititems_links ignores exceptions of its callback, so the callback returns what it finds.
    external = file.visititems_links(external_link)
    if external is not None:
        raise FileError(
            f"{path}: {external[0]} links to another file, {external[1][:60]!r}, which posefuse does not follow. Store "
            "all data in one file."
        )
    file.visititems(check)
    check_unpacked_size(path, total)


def _check_is_internal(path: Path, name: str, data: h5py.Dataset) -> None:
    """Refuse data stored in other files, and data that is compressed more than once."""
    creation = data.id.get_create_plist()
    if creation.get_external_count() or data.is_virtual:
        raise FileError(
            f"{path}: the data of {name} is stored in another file, which posefuse does not read. Store all data in "
            "one file."
        )
    numbers = [creation.get_filter(i)[0] for i in range(creation.get_nfilters())]
    packed = [_COMPRESSION_FILTERS[number] for number in numbers if number in _COMPRESSION_FILTERS]
    if len(packed) > 1:
        raise FileError(
            f"{path}: {name} is compressed {len(packed)} times ({', '.join(packed)}). The file is not read."
        )


def _check_chunk_sizes(path: Path, name: str, data: h5py.Dataset) -> None:
    """Refuse deflated chunks whose content is larger than a chunk: the library decompresses all of it.

    Only chunks that could exceed the allowed size of the file are decompressed here. There are few in any file.
    """
    creation = data.id.get_create_plist()
    if data.chunks is None or _DEFLATE not in [creation.get_filter(i)[0] for i in range(creation.get_nfilters())]:
        return
    harmless = max_unpacked_bytes(path) // _MAX_DEFLATE_RATIO
    if data.id.get_storage_size() <= harmless:
        return
    large: list[tuple[int, ...]] = []
    data.id.chunk_iter(lambda chunk: large.append(chunk.chunk_offset) if chunk.size > harmless else None)
    room = math.prod(data.chunks) * data.dtype.itemsize + _CHECKSUM_BYTES
    for offset in large:
        _, content = data.id.read_direct_chunk(offset)
        if len(zlib.decompressobj().decompress(content, room + 1)) > room:
            raise FileError(f"{path}: a chunk of {name} at {offset} exceeds {room} bytes. The file is not read.")


def _all_bytes(data: h5py.Dataset) -> int:
    return math.prod(data.shape or ()) * data.dtype.itemsize


def _range_bytes(data: h5py.Dataset) -> int:
    if len(data.shape or ()) < _RANGED_AXES:
        return _all_bytes(data)
    return math.prod(data.chunks) * data.dtype.itemsize if data.chunks else 0
