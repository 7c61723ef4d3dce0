"""Arrays: the order of their axes, and how a model noun may hold one that is not in memory.

Axes come in this order, absent ones dropped: frame, view, person, keypoint, xyz (or the two of a pixel). All numbers
are float64 unless a field says otherwise; missing is NaN.

A noun's array may be a NumPy array or anything that reads itself by ranges of its first axis: a memory map, a netCDF
or HDF5 variable. Then ``noun.frames(start, stop)`` brings a range into memory, and nothing else does.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Any, Protocol

import numpy as np


class ArraySource(Protocol):
    """An array that can be read by ranges of its first axis."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        ...

    @property
    def dtype(self) -> Any:
        """Kind of number."""
        ...

    def __getitem__(self, key: Any, /) -> Any: ...


def frozen(array: Any, dtype: Any = np.float64) -> np.ndarray:
    """A read-only array of the given type; no copy where none is needed."""
    out = np.asarray(array, dtype=dtype)
    if out.flags.writeable:
        out = out.view()
        out.flags.writeable = False
    return out


class Stretch:
    """Some rows of an array, read when they are first asked for, and kept as long as this is.

    Args:
        source: the array.
        start: the first row.
        stop: the row after the last.
    """

    def __init__(self, source: ArraySource, start: int, stop: int) -> None:
        self._source, self._start, self._stop = source, start, stop
        self._read: np.ndarray | None = None
        self.shape: tuple[int, ...] = (stop - start, *source.shape[1:])
        self.dtype = source.dtype

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> np.ndarray:
        if self._read is None:
            self._read = np.asarray(self._source[self._start : self._stop])
        return np.asarray(self._read[key])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self[:], dtype=dtype, copy=copy)


def in_memory(source: ArraySource) -> bool:
    """Whether the numbers are at hand, so that checking them costs no reading."""
    return isinstance(source, np.ndarray) and not isinstance(source, np.memmap)


def check_shape(
    error: Callable[[str], Exception], owner: str, name: str, source: ArraySource, **axes: int | None
) -> None:
    """Raise ``error`` unless the array has the named axes; ``None`` lets an axis have any length."""
    wanted = tuple(axes.values())
    shape = tuple(source.shape)
    fits = len(shape) == len(wanted) and all(w is None or w == s for w, s in zip(wanted, shape, strict=True))
    if not fits:
        lengths = ", ".join("any" if w is None else str(w) for w in wanted)
        raise error(
            f"{owner}.{name}: expected the axes ({', '.join(axes)}) = ({lengths}), got an array of shape {shape}."
        )


def ranges(length: int, size: int) -> Iterator[tuple[int, int]]:
    """Cut ``length`` into consecutive (start, stop) of at most ``size``."""
    for start in range(0, length, size):
        yield start, min(start + size, length)


def same(a: Any, b: Any) -> bool:
    """Equality of two field values, NaN equal to NaN and arrays by content."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        a, b = np.asarray(a), np.asarray(b)
        return a.shape == b.shape and bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f"))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, float) and isinstance(b, float) and math.isnan(a):
        return math.isnan(b)
    return bool(a == b)


class Rebuilt:
    """Dataclasses that pickle as their fields, and are made anew from them: checked, and their arrays frozen again.

    A frozen array comes out of a pickle writable, which kernels take for another type: compiled anew, and with other
    rounding.
    """

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return type(self), tuple(getattr(self, each.name) for each in fields(self))  # type: ignore[arg-type]
