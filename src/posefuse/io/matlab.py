"""Reader of MATLAB level 5 ``.mat`` files (``save -v7`` and older): numbers, strings, cells and structs.

``scipy.io.loadmat`` is not used because a broken file terminates the process (``test_scipy_crashes_on_nested_cells``
holds one). Here every length is checked against the file. Format: MathWorks, "MAT-File Format", level 5.
"""

import math
import struct
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError

_NUMBERS = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8", 16: "u1", 17: "u2",
    18: "u4",
}  # fmt: skip
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _CHAR, _FIRST_NUMBER, _LAST_NUMBER = 1, 2, 4, 6, 15
_HEADER_BYTES = 128
_LARGE_BYTES = 256_000_000
_MAX_UNPACKED_RATIO = 200
_MAX_DEPTH = 12


class _Broken(Exception):
    """The bytes violate the format."""


def read_mat(path: Path, names: Iterable[str]) -> dict[str, Any]:
    """Return those of the named variables that a file contains.

    Args:
        path: The file.
        names: Names of variables. Others are skipped.

    Returns:
        Value by name: numbers as arrays in MATLAB's shape, a string as str, cells as an object array, structs as an
        object array of dicts.

    Raises:
        FileError: If the file is in another format or broken.
    """
    requested = set(names)
    try:
        data = memoryview(path.read_bytes())
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}.") from None
    if bytes(data[:8]) == b"\x89HDF\r\n\x1a\n" or b"MATLAB 7.3" in bytes(data[:32]):
        raise FileError(f"{path} is a MATLAB 7.3 file, which posefuse does not read. Save it with save(..., '-v7').")
    if len(data) < _HEADER_BYTES or bytes(data[126:128]) not in (b"IM", b"MI"):
        raise FileError(f"{path} is not a MATLAB level 5 file.")
    order = "<" if bytes(data[126:128]) == b"IM" else ">"
    try:
        return dict(_variables(data[_HEADER_BYTES:], order, requested))
    except (_Broken, struct.error, zlib.error, ValueError, OverflowError, MemoryError) as error:
        raise FileError(f"{path} is not a complete MATLAB file: {str(error)[:120]}. Is the file truncated?") from None


def variable_names(path: Path) -> set[str]:
    """Return the names of a file's variables. A broken file or one in another format has none or only the first."""

    class NameRecorder:
        """Container that records the names whose membership is tested."""

        def __init__(self) -> None:
            self.names: set[str] = set()

        def __contains__(self, name: object) -> bool:
            self.names.add(str(name))
            return False

    recorder = NameRecorder()
    try:
        data = memoryview(path.read_bytes())
        if len(data) >= _HEADER_BYTES and bytes(data[126:128]) in (b"IM", b"MI"):
            order = "<" if bytes(data[126:128]) == b"IM" else ">"
            for _ in _variables(data[_HEADER_BYTES:], order, recorder):
                pass
    except (_Broken, struct.error, zlib.error, ValueError, OverflowError, MemoryError, OSError):
        pass
    return recorder.names


def _variables(data: memoryview, order: str, requested: Any) -> Iterator[tuple[str, Any]]:
    for kind, body in _elements(data, order):
        if kind == _COMPRESSED:
            decompressor = zlib.decompressobj()
            limit = max(_LARGE_BYTES, _MAX_UNPACKED_RATIO * len(body))
            unpacked = decompressor.decompress(body, limit)
            if decompressor.unconsumed_tail:
                raise _Broken(f"a variable of {len(body)} bytes expands to more than {limit}")
            kind, body = next(_elements(memoryview(unpacked), order), (0, memoryview(b"")))
        if kind == _MATRIX and len(body):
            name = _header(body, order)[2]
            if name in requested:
                yield name, _matrix(body, order, 0)


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield the type and bytes of the elements one after another."""
    at = 0
    while at < len(data):
        if len(data) - at < 8:
            raise _Broken("it ends inside a tag")
        kind, size = struct.unpack_from(order + "II", data, at)
        if kind >> 16:  # small element: at most four bytes, stored inside the tag
            kind, size, start, step = kind & 0xFFFF, kind >> 16, at + 4, 8
            if size > 4:
                raise _Broken(f"a small element of {size} bytes")
        else:
            start, step = at + 8, 8 + (size if kind == _COMPRESSED else -(-size // 8) * 8)
        if start + size > len(data):
            raise _Broken(f"expected an element of {size} bytes, {len(data) - start} are left")
        yield kind, data[start : start + size]
        at += step


def _header(body: memoryview, order: str) -> tuple[int, tuple[int, ...], str, Iterator[tuple[int, memoryview]]]:
    """Return the class, shape and name of a matrix, and its remaining elements."""
    rest = _elements(body, order)
    flags = _numbers(next(rest, (0, memoryview(b""))), order)
    sizes = _numbers(next(rest, (0, memoryview(b""))), order)
    shape = tuple(sizes.tolist()) if sizes.dtype.kind in "iu" else ()
    name = bytes(next(rest, (0, memoryview(b"")))[1]).decode("latin1")
    if not len(flags) or not shape or min(shape) < 0:
        raise _Broken("a variable without class or shape")
    return int(flags[0]) & 0xFF, shape, name, rest


def _numbers(element: tuple[int, memoryview], order: str) -> np.ndarray:
    kind, body = element
    if kind not in _NUMBERS:
        raise _Broken(f"unknown number type {kind}")
    return np.frombuffer(body, dtype=order + _NUMBERS[kind])


def _matrix(body: memoryview, order: str, depth: int) -> Any:
    """Return the value of a matrix element of any class."""
    if depth > _MAX_DEPTH:
        raise _Broken(f"cells are nested more than {_MAX_DEPTH} levels deep")
    if not len(body):
        return np.empty((0, 0))
    kind, shape, _, rest = _header(body, order)
    count = math.prod(shape)
    if kind == _CELL:
        return _cells(rest, order, shape, count, depth)
    if kind == _STRUCT:
        return _structs(rest, order, shape, count, depth)
    if kind == _CHAR or _FIRST_NUMBER <= kind <= _LAST_NUMBER:
        values = _numbers(next(rest, (0, memoryview(b""))), order)
        if len(values) != count:
            raise _Broken(f"expected {count} numbers, got {len(values)}")
        array = values.reshape(shape, order="F")
        return _text(array) if kind == _CHAR else array
    return None  # sparse arrays, objects and functions are not needed


def _text(array: np.ndarray) -> str:
    codes = array.ravel(order="C").tolist()
    return "".join(chr(code) if 0 <= code < 0x110000 else "?" for code in codes)


def _inner(rest: Iterator[tuple[int, memoryview]], order: str, depth: int) -> Any:
    kind, body = next(rest, (0, memoryview(b"")))
    if kind != _MATRIX:
        raise _Broken("a cell or field without a value")
    return _matrix(body, order, depth + 1)


def _filled(values: list[Any], shape: tuple[int, ...]) -> np.ndarray:
    cells = np.empty(len(values), dtype=object)
    for i, value in enumerate(values):  # one by one: NumPy would merge arrays of equal size into one array
        cells[i] = value
    return cells.reshape(shape, order="F")


def _cells(
    rest: Iterator[tuple[int, memoryview]], order: str, shape: tuple[int, ...], count: int, depth: int
) -> np.ndarray:
    return _filled([_inner(rest, order, depth) for _ in range(count)], shape)


def _structs(
    rest: Iterator[tuple[int, memoryview]], order: str, shape: tuple[int, ...], count: int, depth: int
) -> np.ndarray:
    length = _numbers(next(rest, (0, memoryview(b""))), order)
    names = bytes(next(rest, (0, memoryview(b"")))[1])
    width = int(length[0]) if len(length) else 0
    if width < 1:
        raise _Broken("a struct without fields")
    fields = [names[at : at + width].split(b"\0")[0].decode("latin1") for at in range(0, len(names), width)]
    if not fields:
        return np.empty((0, 0), dtype=object)
    return _filled([{field: _inner(rest, order, depth) for field in fields} for _ in range(count)], shape)
