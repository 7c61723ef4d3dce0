"""Arrays that stay in their files and behave like NumPy arrays."""

import operator
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any, NoReturn, cast

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin


class LazyArray(NDArrayOperatorsMixin, ABC):
    """Read-only array that is read from its file when it is used.

    An index or a slice of the first axis reads these rows only. Everything else that NumPy arrays offer (operators,
    functions, masks, methods) reads the whole array once, keeps it in memory, and returns what it returns for that
    array.

    Args:
        shape: lengths of the axes.
        dtype: type of the elements.
    """

    def __init__(self, shape: tuple[int, ...], dtype: Any) -> None:
        self.shape, self.dtype = tuple(int(length) for length in shape), np.dtype(dtype)
        self._loaded: np.ndarray | None = None

    @abstractmethod
    def read_rows(self, start: int, stop: int) -> np.ndarray:
        """Read the rows from ``start`` to ``stop`` (excluded), both within the array."""

    def load(self) -> np.ndarray:
        """Return the whole array, read-only. It is read once."""
        if self._loaded is None:
            loaded = np.asarray(self._rows(0, len(self))).view()
            loaded.flags.writeable = False
            self._loaded = loaded
        return self._loaded

    def _rows(self, start: int, stop: int) -> np.ndarray:
        if stop <= start:
            return np.empty((0, *self.shape[1:]), dtype=self.dtype)
        return np.asarray(self.read_rows(start, stop))

    def __getitem__(self, key: Any) -> Any:
        first, *rest = key if isinstance(key, tuple) and key else (key,)
        if self._loaded is None and isinstance(first, slice):
            start, stop, step = first.indices(len(self))
            low, high = (start, stop) if step > 0 else (stop + 1, start + 1)
            return self._rows(low, max(high, low))[(slice(None, None, step), *rest)]
        if self._loaded is None and isinstance(first, (int, np.integer)) and not isinstance(first, bool):
            row = operator.index(first)
            if not -len(self) <= row < len(self):
                raise IndexError(f"Index {row} is out of bounds for axis 0 with size {len(self)}.")
            row %= len(self)
            return self._rows(row, row + 1)[(0, *rest)]
        if self._loaded is None and not rest and (rows := _row_indices(first, len(self))) is not None:
            low = int(rows.min(initial=len(self)))
            return self._rows(low, int(rows.max(initial=low - 1)) + 1)[rows - low]
        return self.load()[key]

    def __setitem__(self, key: Any, value: Any) -> NoReturn:
        raise ValueError("This array belongs to a file and is read-only. Modify a copy: np.array(...).")

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.load(), dtype=dtype, copy=copy)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        if any(isinstance(out, LazyArray) for out in kwargs.get("out", ())):
            self[...] = None
        return getattr(ufunc, method)(*_loaded(inputs), **_loaded(kwargs))

    def __array_function__(
        self, func: Callable[..., Any], types: Any, args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> Any:
        return func(*_loaded(args), **_loaded(kwargs))

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or not hasattr(np.ndarray, name):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return getattr(self.load(), name)

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    @property
    def size(self) -> int:
        """Number of elements."""
        return int(np.prod(self.shape, dtype=np.int64))

    @property
    def nbytes(self) -> int:
        """Bytes of the elements in memory."""
        return self.size * self.dtype.itemsize

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("len() of unsized object")
        return self.shape[0]

    def __iter__(self) -> Iterator[Any]:
        return iter(self.load())

    def __contains__(self, value: Any) -> bool:
        return value in self.load()

    def __bool__(self) -> bool:
        return bool(self.load())

    def __int__(self) -> int:
        return int(self.load())

    def __float__(self) -> float:
        return float(self.load())

    def __complex__(self) -> complex:
        return complex(self.load())

    def __index__(self) -> int:
        return operator.index(self.load())

    def __copy__(self) -> np.ndarray:
        return self.load().copy()

    def __deepcopy__(self, memo: Any) -> np.ndarray:
        return self.load().copy()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_loaded": None}

    def __repr__(self) -> str:
        return f"{type(self).__name__}(shape={self.shape}, dtype={self.dtype})"

    __hash__ = None  # type: ignore[assignment]


def _in_place(name: str) -> Callable[[Any, Any], Any]:
    function = getattr(operator, name)
    return lambda array, other: function(array, other)


# ``array += 1`` binds the name to a new array, as for every immutable object.
for _name in (
    "add",
    "sub",
    "mul",
    "truediv",
    "floordiv",
    "mod",
    "pow",
    "matmul",
    "and",
    "or",
    "xor",
    "lshift",
    "rshift",
):
    setattr(LazyArray, f"__i{_name}__", _in_place(f"__{_name}__"))


def as_array(lazy: LazyArray) -> np.ndarray:
    """Return a lazy array as what it is to users: a NumPy array."""
    return cast("np.ndarray", lazy)


def _row_indices(key: Any, length: int) -> np.ndarray | None:
    """Return the rows of an index array or mask of the first axis, or None if the key is something else."""
    if not isinstance(key, (list, np.ndarray)):
        return None
    indices = np.asarray(key)
    if indices.dtype == bool and indices.shape == (length,):
        return np.flatnonzero(indices)
    if indices.dtype.kind not in "iu":
        return None
    if indices.size and (indices.min() < -length or indices.max() >= length):
        raise IndexError(f"Index {key} is out of bounds for axis 0 with size {length}.")
    return np.where(indices < 0, indices + length, indices)


def _loaded(value: Any) -> Any:
    """Replace lazy arrays within nested arguments by the arrays."""
    if isinstance(value, LazyArray):
        return value.load()
    if isinstance(value, (list, tuple)):
        items = [_loaded(each) for each in value]
        return items if isinstance(value, list) else tuple(items)
    if isinstance(value, dict):
        return {name: _loaded(each) for name, each in value.items()}
    return value
