"""What a parquet file says of its row groups, read by ourselves.

The library's own look at a column's description ends the process where that is broken, instead of raising an error:
https://parquet.apache.org/docs/file-format/metadata/ in Thrift's compact protocol.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_MAGIC = b"PAR1"
_TYPES = ("BOOLEAN", "INT32", "INT64", "INT96", "FLOAT", "DOUBLE", "BYTE_ARRAY", "FIXED_LEN_BYTE_ARRAY")
_DEEPEST = 32
"""Descriptions nest a few levels deep."""

# The numbers that the format gives to what we read of a description.
_ROW_GROUPS, _COLUMNS, _GROUP_BYTES, _COLUMN = 4, 1, 2, 3
_TYPE, _PATH, _VALUES, _UNCOMPRESSED = 1, 3, 5, 6


@dataclass(frozen=True)
class Column:
    """A column's part of a row group.

    Attributes:
        path: names, with dots between nested ones.
        physical_type: as the format calls it.
        n_values: how many, nulls among them.
        uncompressed_bytes: of its pages.
    """

    path: str
    physical_type: str
    n_values: int
    uncompressed_bytes: int


@dataclass(frozen=True)
class RowGroup:
    """Rows that are stored together: their columns, and the bytes of these without compression."""

    columns: tuple[Column, ...]
    uncompressed_bytes: int


def row_groups(path: Path) -> tuple[RowGroup, ...]:
    """Those that a file describes.

    Raises:
        ValueError: if it is no parquet file, or what it says of itself is broken.
    """
    return tuple(_group(group) for group in _listed(_Compact(_footer(path)).struct(), _ROW_GROUPS))


def _footer(path: Path) -> bytes:
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - 8, 0))
        end = file.read(8)
        length = int.from_bytes(end[:4], "little")
        if len(end) < 8 or end[4:] != _MAGIC or length > size - 12:
            raise ValueError("it does not end as parquet files do")
        file.seek(size - 8 - length)
        return file.read(length)


def _group(told: dict[int, Any]) -> RowGroup:
    columns = tuple(_column(_of(column, _COLUMN, dict)) for column in _listed(told, _COLUMNS))
    return RowGroup(columns, _of(told, _GROUP_BYTES, int))


def _column(told: dict[int, Any]) -> Column:
    kind = _of(told, _TYPE, int)
    if not 0 <= kind < len(_TYPES):
        raise ValueError(f"a column is of type {kind}, which there is not")
    names = _of(told, _PATH, list)
    if not all(isinstance(name, bytes) for name in names):
        raise ValueError("a column has no name")
    path = ".".join(name.decode("utf-8") for name in names)
    sizes = _of(told, _VALUES, int), _of(told, _UNCOMPRESSED, int)
    if min(sizes) < 0:
        raise ValueError(f"column {path} has {sizes[0]} values in {sizes[1]} bytes")
    return Column(path, _TYPES[kind], *sizes)


def _listed(told: dict[int, Any], field: int) -> list[dict[int, Any]]:
    found = _of(told, field, list)
    if not all(isinstance(each, dict) for each in found):
        raise ValueError(f"field {field} of its description is not what it has to be")
    return found


def _of(told: dict[int, Any], field: int, kind: type) -> Any:
    found = told.get(field)
    if not isinstance(found, kind) or isinstance(found, bool):
        raise ValueError(f"field {field} of its description is missing, or not what it has to be")
    return found


class _Compact:
    """A reader of Thrift's compact protocol: structures are dictionaries by the numbers of their fields."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at, self._depth = content, 0, 0
        whole: Callable[[], Any] = self._whole
        self._readers: dict[int, Callable[[], Any]] = {
            1: lambda: True, 2: lambda: False, 3: self._byte, 4: whole, 5: whole, 6: whole, 7: self._double,
            8: self._bytes, 9: self._list, 10: self._list, 11: self._map, 12: self.struct,
        }  # fmt: skip

    def struct(self) -> dict[int, Any]:
        """The structure that begins here."""
        self._deeper()
        found: dict[int, Any] = {}
        field = 0
        while head := self._byte():
            field = field + (head >> 4) if head >> 4 else self._whole()
            found[field] = self._value(head & 15)
        self._depth -= 1
        return found

    def _value(self, kind: int) -> Any:
        if kind not in self._readers:
            raise ValueError(f"its description holds type {kind}, which there is not")
        return self._readers[kind]()

    def _list(self) -> list[Any]:
        self._deeper()
        head = self._byte()
        n, kind = head >> 4 if head >> 4 < 15 else self._varint(), head & 15
        # Whether it is true is a byte of its own within lists, and part of the head within structures.
        found = [self._byte() if kind in (1, 2) else self._value(kind) for _ in range(self._possible(n))]
        self._depth -= 1
        return found

    def _map(self) -> None:
        """No field that we read is one."""
        raise ValueError("its description holds a map, which parquet has none of")

    def _bytes(self) -> bytes:
        return self._take(self._varint())

    def _double(self) -> float:
        return struct.unpack("<d", self._take(8))[0]

    def _whole(self) -> int:
        folded = self._varint()
        return (folded >> 1) ^ -(folded & 1)

    def _varint(self) -> int:
        found = 0
        for shift in range(0, 70, 7):
            byte = self._byte()
            found |= (byte & 127) << shift
            if byte < 128:
                return found
        raise ValueError("a number of its description does not end")

    def _byte(self) -> int:
        return self._take(1)[0]

    def _take(self, n: int) -> bytes:
        start, self._at = self._at, self._at + self._possible(n)
        return self._content[start : self._at]

    def _possible(self, n: int) -> int:
        """How many bytes, or things of a byte at least, which have to be there."""
        if n > len(self._content) - self._at:
            raise ValueError("its description is cut short")
        return n

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ValueError("its description is nested too deeply")
