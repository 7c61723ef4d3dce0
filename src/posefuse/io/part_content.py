"""The content of a checkpoint: compressed records and arrays.

A part is a line of JSON, the compressed pickle, and each large array, compressed on its own, so that storing a part
takes little more memory than its compressed bytes.
"""

import hashlib
import json
import os
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from io import BytesIO
from typing import Any, BinaryIO, Self

import numpy as np
from backports import zstd

from posefuse.pickled import pickled

_PICKLE_BYTES = 8
"""Item size that pickles are compressed as, because most of their bytes are float64 numbers."""
_CACHED_NUMBERS = 8192
_COMPRESSION_LEVEL = -1
"""Level 1 takes nearly twice the time for a tenth less."""
_OURS = (
    "posefuse.model.",
    "posefuse.skeleton.",
    "posefuse.kinematics.",
    "posefuse.tracking.",
    "posefuse.pipeline.people.",
    "posefuse.kernels.",
)
_FOREIGN = {
    ("array", "array"),
    ("array", "_array_reconstructor"),
    ("collections", "OrderedDict"),
    ("collections", "deque"),
    ("functools", "partial"),
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy._core.numeric", "_frombuffer"),
}
_FUNCTIONS = {
    ("posefuse.association.pair_energy", "propose_by_energy"),
    ("posefuse.pipeline.people.initial_noise", "propose_people"),
    ("posefuse.tracking.strategies.specification", "configure"),
    ("posefuse.tracking.strategy", "same_settings"),
}


@dataclass(frozen=True, eq=False)
class Packed:
    """A value in compressed pieces: its pickle, and each of its large arrays.

    Attributes:
        pieces: compressed bytes.
        sizes: size of each piece before compression, and the item size that it was compressed as.
    """

    pieces: tuple[bytes, ...]
    sizes: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, head: bytes, arrays: Sequence[pickle.PickleBuffer] = ()) -> Self:
        """Compress what :func:`posefuse.pickled.pickled` returns."""
        given = [(memoryview(head), _PICKLE_BYTES), *((each.raw(), memoryview(each).itemsize) for each in arrays)]
        return cls(tuple(packed(*each) for each in given), tuple((memory.nbytes, width) for memory, width in given))

    def unpacked(self) -> Any:
        """Return the value.

        Raises:
            pickle.UnpicklingError: if it has objects that parts never hold.
            ValueError: if a piece has another size.
        """
        head, *arrays = (unpacked(piece, *size) for piece, size in zip(self.pieces, self.sizes, strict=True))
        return loaded(bytes(head), arrays)

    def write(self, file: BinaryIO, fields: Mapping[str, Any]) -> None:
        """Write the value as a part, with fields that its first line states."""
        lengths = [len(piece) for piece in self.pieces]
        head = {**fields, "pieces": [[length, *size] for length, size in zip(lengths, self.sizes, strict=True)]}
        file.write(json.dumps({**head, "sha256": self._digest(head)}, sort_keys=True).encode() + b"\n")
        file.writelines(self.pieces)

    @classmethod
    def read(cls, file: BinaryIO) -> tuple[dict[str, Any], Self]:
        """Return the fields and the value of a part.

        Raises:
            ValueError, KeyError, TypeError: if it is damaged.
        """
        head = json.loads(file.readline())
        digest = head.pop("sha256")
        rows, start = head["pieces"], file.tell()
        if min(length for length, _, _ in rows) < 0 or sum(row[0] for row in rows) != file.seek(0, os.SEEK_END) - start:
            raise ValueError("the length differs")
        file.seek(start)
        found = cls(tuple(file.read(length) for length, _, _ in rows), tuple((size, width) for _, size, width in rows))
        if digest != found._digest(head):
            raise ValueError("the digest differs")
        return head, found

    def _digest(self, head: Mapping[str, Any]) -> str:
        digest = hashlib.sha256(json.dumps(head, sort_keys=True).encode())
        for piece in self.pieces:
            digest.update(piece)
        return digest.hexdigest()


def packed(content: memoryview, width: int = _PICKLE_BYTES) -> bytes:
    """Compress bytes that are mostly numbers: the first bytes of all numbers, then the second ones, and so on.

    Args:
        content: bytes.
        width: item size of the numbers.
    """
    whole = len(content) - len(content) % width
    if width == 1 or not whole:
        return zstd.compress(content, _COMPRESSION_LEVEL)
    given = np.frombuffer(content, dtype=np.uint8)
    numbers, ordered = given[:whole].reshape(-1, width), np.empty(len(content), dtype=np.uint8)
    planes = ordered[:whole].reshape(width, -1)
    # Pieces that fit in the cache are transposed in half the time.
    for start in range(0, len(numbers), _CACHED_NUMBERS):
        planes[:, start : start + _CACHED_NUMBERS] = numbers[start : start + _CACHED_NUMBERS].T
    ordered[whole:] = given[whole:]
    return zstd.compress(ordered.data, _COMPRESSION_LEVEL)


def unpacked(content: bytes, size: int, width: int = _PICKLE_BYTES) -> bytearray:
    """Return the bytes that :func:`packed` compressed.

    Raises:
        ValueError: if they have another size.
    """
    ordered = zstd.ZstdDecompressor().decompress(content, max_length=size)
    if len(ordered) != size:
        raise ValueError(f"{len(ordered)} bytes instead of {size}")
    whole = size - size % width
    if width == 1 or not whole:
        return bytearray(ordered)
    found = bytearray(size)
    given, out = np.frombuffer(ordered, dtype=np.uint8), np.frombuffer(found, dtype=np.uint8)
    out[:whole].reshape(-1, width)[:] = given[:whole].reshape(width, -1).T
    out[whole:] = given[whole:]
    return found


def copied(value: Any) -> tuple[bytes, Any]:
    """Return the pickle of a value with all of its arrays, and the value that it holds."""
    content = pickle.dumps(value, protocol=5)
    return content, loaded(content)


def compressed(value: Any) -> tuple[Packed, Any]:
    """Return a value in compressed pieces, and the value that they hold, which shares the memory of its arrays."""
    head, arrays = pickled(value)
    return Packed.of(head, arrays), loaded(head, arrays)


def loaded(content: bytes, arrays: Sequence[pickle.PickleBuffer | bytearray] = ()) -> Any:
    """Return the value of a pickle.

    Raises:
        pickle.UnpicklingError: if it has objects that parts never hold.
    """
    return _Unpickler(BytesIO(content), buffers=arrays).load()


def _member(enumeration: Any, name: str) -> Enum:
    """Return a member of an enumeration.

    Raises:
        pickle.UnpicklingError: for an attribute of anything else.
    """
    if isinstance(enumeration, type) and issubclass(enumeration, Enum) and name in enumeration.__members__:
        return enumeration[name]
    raise pickle.UnpicklingError(f"a part of a reconstruction cannot hold {enumeration!r}.{name}")


class _Unpickler(pickle.Unpickler):
    """Creates arrays and posefuse's own records only, since a folder of parts may come from an untrusted source."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a class that parts consist of.

        Raises:
            pickle.UnpicklingError: for any other class or function.
        """
        if (module, name) in _FOREIGN | _FUNCTIONS:
            return super().find_class(module, name)
        if (module, name) == ("builtins", "getattr"):
            # Early releases of Python 3.11 store members of enumerations as attributes of their class.
            return _member
        if module.startswith(_OURS):
            found = super().find_class(module, name)
            if isinstance(found, type) and found.__module__ == module:
                return found
        raise pickle.UnpicklingError(f"a part of a reconstruction cannot hold {module}.{name}")
