"""Reader of the columns, row-group sizes and names of metadata in the footer of a parquet file.

``pyarrow`` is not used because reading a broken column description aborts the process instead of raising an error
(``test_pyarrow_aborts_on_a_broken_column`` holds such a file). Format: https://parquet.apache.org/docs/file-format/metadata/
in Thrift's compact protocol.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_MAGIC = b"PAR1"
_TYPES = ("BOOLEAN", "INT32", "INT64", "INT96", "FLOAT", "DOUBLE", "BYTE_ARRAY", "FIXED_LEN_BYTE_ARRAY")
_MAX_DEPTH = 32
"""Footers of valid files nest only a few levels deep."""

# Field numbers of the Thrift definition.
_SCHEMA, _ROW_GROUPS, _METADATA, _COLUMNS, _GROUP_BYTES, _COLUMN = 2, 4, 5, 1, 2, 3
_ELEMENT_NAME, _CHILDREN, _CONVERTED_TYPE, _KEY = 4, 5, 6, 1
_TYPE, _PATH, _VALUES, _UNCOMPRESSED = 1, 3, 5, 6


@dataclass(frozen=True)
class Column:
    """The part of a column in one row group.

    Attributes:
        path: Name of the column, with dots between nested names.
        physical_type: Name of the type in the format.
        n_values: Number of values, including nulls.
        uncompressed_bytes: Size of its pages without compression.
    """

    path: str
    physical_type: str
    n_values: int
    uncompressed_bytes: int


@dataclass(frozen=True)
class RowGroup:
    """Rows that are stored together.

    Attributes:
        columns: The columns.
        uncompressed_bytes: Size of the columns without compression.
    """

    columns: tuple[Column, ...]
    uncompressed_bytes: int


def row_groups(path: Path) -> tuple[RowGroup, ...]:
    """Return the row groups that the footer of a file describes.

    Raises:
        ValueError: If the file is not parquet or its footer is broken.
    """
    return tuple(_group(group) for group in _structs(_CompactReader(_footer(path)).struct(), _ROW_GROUPS))


def schema(path: Path) -> list[tuple[str, tuple[str, ...]]]:
    """Return the name of every column, and the names of its fields if it is a struct.

    Raises:
        ValueError: If the file is not parquet or its footer is broken.
    """
    elements = iter(_structs(_CompactReader(_footer(path)).struct(), _SCHEMA))
    return _children(elements, next(elements, {}), 0)


def _children(
    elements: Iterator[dict[int, Any]], parent: dict[int, Any], depth: int
) -> list[tuple[str, tuple[str, ...]]]:
    """Take the descendants of an element; return the name of each child, and the names of the fields of structs."""
    found = []
    for _ in range(_field(parent, _CHILDREN, int) if _CHILDREN in parent else 0):
        element = next(elements, None)
        if element is None or depth > _MAX_DEPTH:
            raise ValueError("its schema is truncated")
        inner = _children(elements, element, depth + 1)
        # Lists and maps are groups as well, and have a converted type.
        fields = () if _CONVERTED_TYPE in element else tuple(name for name, _ in inner)
        found.append((_field(element, _ELEMENT_NAME, bytes).decode("utf-8"), fields))
    return found


def metadata_keys(path: Path) -> list[str]:
    """Return the names of the metadata.

    Raises:
        ValueError: If the file is not parquet or its footer is broken.
    """
    fields = _CompactReader(_footer(path)).struct()
    pairs = _structs(fields, _METADATA) if _METADATA in fields else []
    return [_field(pair, _KEY, bytes).decode("utf-8") for pair in pairs]


def _footer(path: Path) -> bytes:
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - 8, 0))
        end = file.read(8)
        length = int.from_bytes(end[:4], "little")
        if len(end) < 8 or end[4:] != _MAGIC or length > size - 12:
            raise ValueError("it does not end like a parquet file")
        file.seek(size - 8 - length)
        return file.read(length)


def _group(fields: dict[int, Any]) -> RowGroup:
    columns = tuple(_column(_field(column, _COLUMN, dict)) for column in _structs(fields, _COLUMNS))
    return RowGroup(columns, _field(fields, _GROUP_BYTES, int))


def _column(fields: dict[int, Any]) -> Column:
    kind = _field(fields, _TYPE, int)
    if not 0 <= kind < len(_TYPES):
        raise ValueError(f"a column has the unknown type {kind}")
    names = _field(fields, _PATH, list)
    if not all(isinstance(name, bytes) for name in names):
        raise ValueError("a column has no name")
    path = ".".join(name.decode("utf-8") for name in names)
    sizes = _field(fields, _VALUES, int), _field(fields, _UNCOMPRESSED, int)
    if min(sizes) < 0:
        raise ValueError(f"column {path} has {sizes[0]} values in {sizes[1]} bytes")
    return Column(path, _TYPES[kind], *sizes)


def _structs(fields: dict[int, Any], number: int) -> list[dict[int, Any]]:
    values = _field(fields, number, list)
    if not all(isinstance(each, dict) for each in values):
        raise ValueError(f"field {number} of its footer has the wrong type")
    return values


def _field(fields: dict[int, Any], number: int, kind: type) -> Any:
    value = fields.get(number)
    if not isinstance(value, kind) or isinstance(value, bool):
        raise ValueError(f"field {number} of its footer is missing or has the wrong type")
    return value


class _CompactReader:
    """Reader of Thrift's compact protocol. A structure is returned as a dictionary by field number."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at, self._depth = content, 0, 0
        whole: Callable[[], Any] = self._whole
        self._readers: dict[int, Callable[[], Any]] = {
            1: lambda: True, 2: lambda: False, 3: self._byte, 4: whole, 5: whole, 6: whole, 7: self._double,
            8: self._bytes, 9: self._list, 10: self._list, 11: self._map, 12: self.struct,
        }  # fmt: skip

    def struct(self) -> dict[int, Any]:
        """Read the structure that starts at the current position."""
        self._enter()
        fields: dict[int, Any] = {}
        number = 0
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._whole()
            fields[number] = self._value(head & 15)
        self._depth -= 1
        return fields

    def _value(self, kind: int) -> Any:
        if kind not in self._readers:
            raise ValueError(f"its footer contains the unknown type {kind}")
        return self._readers[kind]()

    def _list(self) -> list[Any]:
        self._enter()
        head = self._byte()
        n, kind = head >> 4 if head >> 4 < 15 else self._varint(), head & 15
        # A boolean is a byte of its own in a list, and part of the head in a structure.
        values = [self._byte() if kind in (1, 2) else self._value(kind) for _ in range(self._check_length(n))]
        self._depth -= 1
        return values

    def _map(self) -> None:
        """Refuse maps, which parquet footers do not contain."""
        raise ValueError("its footer contains a map")

    def _bytes(self) -> bytes:
        return self._take(self._varint())

    def _double(self) -> float:
        return struct.unpack("<d", self._take(8))[0]

    def _whole(self) -> int:
        folded = self._varint()
        return (folded >> 1) ^ -(folded & 1)

    def _varint(self) -> int:
        value = 0
        for shift in range(0, 70, 7):
            byte = self._byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise ValueError("an integer of its footer does not end")

    def _byte(self) -> int:
        return self._take(1)[0]

    def _take(self, n: int) -> bytes:
        start, self._at = self._at, self._at + self._check_length(n)
        return self._content[start : self._at]

    def _check_length(self, n: int) -> int:
        """Return n unless fewer than n bytes are left. Each list item takes at least one byte."""
        if n > len(self._content) - self._at:
            raise ValueError("its footer is truncated")
        return n

    def _enter(self) -> None:
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise ValueError("its footer is nested too deeply")
