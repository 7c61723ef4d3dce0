"""Arrays: the order of their axes, and how a data type may hold an array that is not in memory.

Axes have this order, absent ones dropped: frame, view, person, keypoint, xyz (or the two pixel coordinates). All
numbers are float64 unless a field states otherwise; missing values are NaN.

An array of a data type may be a NumPy array or anything that can be read by ranges of its first axis: a memory map, a
netCDF or HDF5 variable. Only ``frames(start, stop)`` of the data type brings a range into memory.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Any, Protocol

import numpy as np

from posefuse.lazy_array import LazyArray


class ArraySource(Protocol):
    """Array that can be read by ranges of its first axis."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        ...

    @property
    def dtype(self) -> Any:
        """Type of the elements."""
        ...

    def __getitem__(self, key: Any, /) -> Any: ...


def frozen(array: Any, dtype: Any = np.float64) -> np.ndarray:
    """Return a read-only array of the given type, without a copy where none is needed."""
    out = np.asarray(array, dtype=dtype)
    if out.flags.writeable:
        out = out.view()
        out.flags.writeable = False
    return out


def column_medians(values: np.ndarray) -> np.ndarray:
    """Return medians over the first axis, of one row or more, without the NaNs; NaN where there is nothing else.

    NumPy's own function takes ten times as long for short or few columns.
    """
    count = (~np.isnan(values)).sum(axis=0)
    # NaNs are last.
    ordered = np.sort(values, axis=0)
    low, high = (np.take_along_axis(ordered, np.maximum(n, 0)[None], axis=0)[0] for n in ((count - 1) // 2, count // 2))
    return np.where(count > 0, 0.5 * (low + high), np.nan)


def kernel_array(array: Any, dtype: Any = np.float64) -> np.ndarray:
    """Return a read-only contiguous array of the given type, without a copy where none is needed.

    Kernels are compiled once for this layout, and again for any other.
    """
    return frozen(np.ascontiguousarray(array, dtype=dtype), dtype)


class ArrayRange(LazyArray):
    """Range of rows of an array, which is read on first access and then kept in memory.

    Args:
        source: Array to read.
        start: First row.
        stop: Row after the last one.
    """

    def __init__(self, source: ArraySource, start: int, stop: int) -> None:
        super().__init__((stop - start, *source.shape[1:]), source.dtype)
        self._source, self._start = source, start

    def read_rows(self, start: int, stop: int) -> np.ndarray:
        """Read rows."""
        return np.asarray(self._source[self._start + start : self._start + stop])

    def __getitem__(self, key: Any) -> Any:
        return self.load()[key]


def in_memory(source: ArraySource) -> bool:
    """Return whether an array is in memory, so that checking it reads no file."""
    return isinstance(source, np.ndarray) and not isinstance(source, np.memmap)


def check_shape(
    error: Callable[[str], Exception], owner: str, name: str, source: ArraySource, **axes: int | None
) -> None:
    """Check the shape of an array.

    Args:
        error: Class of the exception to raise.
        owner: Name of the data type, for the message.
        name: Name of the array, for the message.
        source: Array to check.
        **axes: Length of each axis by name; None allows any length.
    """
    expected = tuple(axes.values())
    shape = tuple(source.shape)
    fits = len(shape) == len(expected) and all(e is None or e == s for e, s in zip(expected, shape, strict=True))
    if not fits:
        lengths = ", ".join("any" if length is None else str(length) for length in expected)
        raise error(
            f"{owner}.{name}: expected the axes ({', '.join(axes)}) = ({lengths}), got an array of shape {shape}."
        )


def ranges(length: int, size: int) -> Iterator[tuple[int, int]]:
    """Yield consecutive (start, stop) ranges of at most ``size`` that cover ``length``."""
    for start in range(0, length, size):
        yield start, min(start + size, length)


def same(a: Any, b: Any) -> bool:
    """Return whether two field values are equal; arrays compare by content, and NaN equals NaN."""
    if isinstance(a, np.ndarray | LazyArray) or isinstance(b, np.ndarray | LazyArray):
        a, b = np.asarray(a), np.asarray(b)
        return a.shape == b.shape and bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f"))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, float) and isinstance(b, float) and math.isnan(a):
        return math.isnan(b)
    return bool(a == b)


class PickledByFields:
    """Base class of dataclasses that are pickled as their fields and constructed again when they are unpickled.

    The constructor checks the fields and makes their arrays read-only again. Without it, arrays would be writable after
    unpickling; Numba treats those as another type, compiles kernels again, and may round differently.
    """

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return type(self), tuple(getattr(self, each.name) for each in fields(self))  # type: ignore[arg-type]
