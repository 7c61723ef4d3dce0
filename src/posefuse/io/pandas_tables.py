"""Tables of pandas in HDF5 files, read and written without pandas.

The ``fixed`` layout is read and written, the ``table`` layout is read. Columns have names with several levels. Layouts:
pandas' ``io.pytables``. In ``table`` files the column names are pickled; only strings, numbers, tuples and lists are
unpickled.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from posefuse.errors import FileError
from posefuse.io.pickles import load_plain


@dataclass(frozen=True)
class Frame:
    """A table of numbers.

    Attributes:
        columns: Name of each column, one string per level.
        index: Shape (row,), int64.
        values: Shape (row, column).
    """

    columns: list[tuple[str, ...]]
    index: np.ndarray
    values: np.ndarray


def write_frame(
    file: h5py.File,
    key: str,
    levels: Sequence[str],
    columns: Sequence[tuple[str, ...]],
    index: np.ndarray,
    rows: Iterable[np.ndarray],
) -> None:
    """Write a table in pandas' fixed layout.

    Args:
        file: Open for writing.
        key: Name of the table.
        levels: Names of the levels of the column names.
        columns: Name of each column, one string per level.
        index: Shape (row,), integers.
        rows: Consecutive ranges of rows, each of shape (n, column).
    """
    file.attrs.update(_texts(CLASS="GROUP", PYTABLES_FORMAT_VERSION="2.1", TITLE="", VERSION="1.0"))
    group = file.create_group(key)
    group.attrs.update(_texts(CLASS="GROUP", TITLE="", VERSION="1.0"))
    group.attrs.update(_texts(pandas_type="frame", encoding="UTF-8", errors="strict", axis1_variety="regular"))
    group.attrs.update({"ndim": np.int64(2), "nblocks": np.int64(1)})
    for axis in ("axis0", "block0_items"):
        _write_names(group, axis, levels, columns)
    _array(group, "axis1", np.asarray(index, dtype=np.int64), kind="integer", name="N.")
    data = group.create_dataset("block0_values", (len(index), len(columns)), np.float64)
    data.attrs.update({**_texts(CLASS="ARRAY", FLAVOR="numpy", TITLE="", VERSION="2.4"), "transposed": np.uint8(1)})
    start = 0
    for values in rows:
        data[start : start + len(values)] = values
        start += len(values)


def _write_names(group: h5py.Group, axis: str, levels: Sequence[str], columns: Sequence[tuple[str, ...]]) -> None:
    group.attrs.update({**_texts(**{f"{axis}_variety": "multi"}), f"{axis}_nlevels": np.int64(len(levels))})
    for i, level in enumerate(levels):
        names = list(dict.fromkeys(column[i] for column in columns))
        code = {name: number for number, name in enumerate(names)}
        texts = np.array([name.encode() or b"\0" for name in names])
        _array(group, f"{axis}_level{i}", texts, kind="string", name=level, **{f"{axis}_name{level}": level})
        _array(group, f"{axis}_label{i}", np.array([code[column[i]] for column in columns], dtype=np.int32))


def _array(group: h5py.Group, key: str, values: np.ndarray, **attributes: str) -> None:
    data = group.create_dataset(key, data=values)
    data.attrs.update({**_texts(CLASS="ARRAY", FLAVOR="numpy", TITLE="", VERSION="2.4"), "transposed": np.uint8(1)})
    data.attrs.update(_texts(**attributes))


def _texts(**attributes: str) -> dict[str, Any]:
    """Return attributes as fixed-length UTF-8. PyTables reads other strings as bytes, which pandas refuses."""

    def text_of(text: str) -> Any:
        content = text.encode()
        return np.array(content, dtype=h5py.string_dtype("utf-8", len(content))) if content else h5py.Empty("S1")

    return {key: text_of(text) for key, text in attributes.items()}


def read_frame(group: h5py.Group) -> Frame:
    """Read a table in either layout.

    Raises:
        FileError: If the group has neither layout.
    """
    if "table" in group:
        return _read_table(group)
    if "block0_values" not in group or "axis0_level0" not in group:
        raise FileError(f"{group.file.filename}: {group.name} is not a pandas table with multi-level column names.")
    count: Any = group.attrs["block0_items_nlevels"]
    levels = []
    for i in range(int(count)):
        names = [name.decode() for name in np.asarray(group[f"block0_items_level{i}"]).tolist()]
        levels.append([names[code] for code in np.asarray(group[f"block0_items_label{i}"]).tolist()])
    values = np.asarray(group["block0_values"], dtype=np.float64)
    return Frame(list(zip(*levels, strict=True)), np.asarray(group["axis1"], dtype=np.int64), values)


def _read_table(group: h5py.Group) -> Frame:
    pickled: Any = group.attrs["non_index_axes"]
    named = load_plain(bytes(pickled))[0][1]
    columns = [tuple(str(word) for word in column) for column in named]
    table = np.asarray(group["table"])
    values = np.asarray(table["values_block_0"], dtype=np.float64).reshape(len(table), -1)
    return Frame(columns, np.asarray(table["index"], dtype=np.int64), values)
