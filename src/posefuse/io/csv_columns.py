"""CSV files as columns. Numbers are written with the fewest digits that give the same number when read.

Files whose names end in ``.gz`` are compressed.
"""

import csv
import gzip
import io
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import IO

import msgspec
import numpy as np

from posefuse.errors import FileError
from posefuse.io.columns import Column, Columns, Decimals, Words
from posefuse.io.files import max_unpacked_bytes, reading, replacing
from posefuse.kernels.tables.rows import MAX_SCALED, NUMBER_BYTES, NumberCells, WordCells, write_rows

_BLOCK_ROWS = 50_000
_MAX_LINE = 1_000_000
_GZIP_LEVEL = 4
"""A higher level takes more time than all other work on a table and saves a tenth."""


def write_csv(tables: Iterable[Columns], path: Path, *, quoted_header: bool = True) -> None:
    """Write consecutive tables with the same columns as one table; words are quoted.

    Args:
        tables: the tables, one after another in memory.
        path: the file.
        quoted_header: quote all names in the first row; some programs split it at commas and need False.
    """
    with replacing(path) as temporary, _opened(temporary, packed=path.suffix == ".gz") as file:
        for i, columns in enumerate(tables):
            if i == 0:
                file.write(_header(list(columns), quoted=quoted_header))
            cells = [_cells(column) for column in columns.values()]
            file.writelines(b",".join(row) + b"\n" for row in zip(*cells, strict=True))


def write_rounded_csv(tables: Iterable[Mapping[str, Decimals | Words]], path: Path) -> None:
    """Write consecutive tables of rounded numbers and words as :func:`write_csv` does, several times as fast."""
    with replacing(path) as temporary, _opened(temporary, packed=path.suffix == ".gz") as file:
        for i, columns in enumerate(tables):
            if i == 0:
                file.write(_header(list(columns), quoted=True))
            n_rows = len(next(iter(columns.values())))
            for start in range(0, n_rows, _BLOCK_ROWS):
                file.write(_rounded_rows(list(columns.values()), slice(start, min(start + _BLOCK_ROWS, n_rows))))


@contextmanager
def _opened(path: Path, *, packed: bool) -> Iterator[IO[bytes] | gzip.GzipFile]:
    """Open a file for writing; a compressed one holds neither name nor time, so that its bytes are reproducible."""
    with path.open("wb") as file:
        if not packed:
            yield file
            return
        with gzip.GzipFile("", "wb", _GZIP_LEVEL, file, mtime=0) as unpacked:
            yield unpacked


def _any_rows(columns: Sequence[Decimals | Words], rows: slice) -> bytes:
    """Return a range of rows with numbers of any size as text."""
    plain = (column.rounded() if isinstance(column, Decimals) else column for column in columns)
    return b"".join(b",".join(row) + b"\n" for row in zip(*(_cells(column[rows]) for column in plain), strict=True))


def _rounded_rows(columns: Sequence[Decimals | Words], rows: slice) -> bytes:
    """Return a range of rows as text."""
    numbers = [column for column in columns if isinstance(column, Decimals)]
    n_rows = rows.stop - rows.start
    values, decimals = np.empty((len(numbers), n_rows)), np.empty((len(numbers), n_rows), dtype=np.int64)
    for i, column in enumerate(numbers):
        values[i] = column.values[rows]
        decimals[i] = column.decimals if isinstance(column.decimals, int) else column.decimals[rows]
    with np.errstate(invalid="ignore", over="ignore"):
        if not (np.abs(values) * 10.0**decimals < MAX_SCALED)[~np.isnan(values)].all():
            return _any_rows(columns, rows)
    texts, codes, order = [b""], [], []
    for column in columns:
        if isinstance(column, Words):
            order.append(-1 - len(codes))
            own = column.codes[rows].astype(np.int64)
            codes.append(np.where(own < 0, 0, own + len(texts)))
            texts += [_quoted(name) for name in column.names]
        else:
            order.append(len(order) - len(codes))
    lengths = np.array([len(text) for text in texts])
    words = WordCells(
        np.array(codes, dtype=np.int64).reshape(-1, n_rows),
        np.frombuffer(b"".join(texts) or b" ", dtype=np.uint8),
        np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
    )
    longest = len(numbers) * NUMBER_BYTES + len(codes) * int(lengths.max()) + len(columns)
    out = np.empty(n_rows * longest, dtype=np.uint8)
    size = write_rows(NumberCells(values, decimals), words, np.array(order, dtype=np.int64), ord(","), out)
    return out[:size].tobytes()


def _header(names: Sequence[str], *, quoted: bool) -> bytes:
    line = io.StringIO(newline="")
    style = csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL
    csv.writer(line, lineterminator="\n", quoting=style).writerow(names)
    return line.getvalue().encode()


def _cells(column: Column) -> list[bytes]:
    """Return the cells of a column as text."""
    if isinstance(column, np.ndarray) and column.dtype == object:
        column = Words.of(column)
    if isinstance(column, Words):
        words = [_quoted(name) for name in column.names]
        return np.array([*words, b""], dtype=object)[column.codes].tolist()
    if not len(column):
        return []
    # The encoder writes NaN as null, and 1.0 for 1; the comma lets the last cell end like all others.
    text = msgspec.json.encode(np.ma.getdata(column).tolist())[1:-1] + b","
    cells = text.replace(b".0,", b",").replace(b"null", b"")[:-1].split(b",")
    for row in np.flatnonzero(np.ma.getmaskarray(column)):
        cells[row] = b""
    for row in np.flatnonzero(np.isinf(np.ma.getdata(column))):
        cells[row] = str(column[row]).encode()
    return cells


def _quoted(word: str) -> bytes:
    return ('"' + word.replace('"', '""') + '"').encode()


def header(path: Path) -> list[str]:
    """Return the first row of a CSV file.

    Raises:
        FileError: if the file cannot be read as CSV.
    """
    try:
        with _lines(path) as lines:
            return next(csv.reader(lines), [])
    except (UnicodeDecodeError, csv.Error, EOFError, gzip.BadGzipFile) as error:
        raise FileError(f"{path} is not a UTF-8 CSV file: {error}.") from None
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}.") from None


@contextmanager
def _lines(path: Path) -> Iterator[Iterator[str]]:
    """Open a file and return its lines."""
    if path.suffix != ".gz":
        with path.open(newline="", encoding="utf-8-sig") as lines:
            yield lines
        return
    with gzip.open(path, "rt", newline="", encoding="utf-8-sig") as unpacked:
        yield _limited(path, unpacked)


def _limited(path: Path, unpacked: IO[str]) -> Iterator[str]:
    """Yield the lines of a compressed file.

    Raises:
        FileError: if it expands to more than any table does.
    """
    left = max_unpacked_bytes(path)
    while line := unpacked.readline(_MAX_LINE):
        left -= len(line)
        if left < 0:
            raise FileError(f"{path} looks like a decompression bomb and is not read.")
        yield line


def read_csv(path: Path, *, words: Container[str], numbers: Container[str]) -> dict[str, Column]:
    """Read columns of words and of numbers of a CSV file; other columns are left out.

    Empty cells are missing; in columns of numbers, ``nan`` is as well.

    Raises:
        FileError: if a column occurs twice, a row is incomplete, or a column of numbers contains something else.
    """
    with reading(path, "CSV file"), _lines(path) as lines:
        rows = csv.reader(lines, strict=True)
        names = next(rows, [])
        if len(set(names)) != len(names):
            raise FileError(f"{path} has two columns with the same name.")
        found: dict[str, list[np.ndarray]] = {name: [] for name in names if name in words or name in numbers}
        index: dict[str, dict[str, int]] = {name: {"": -1} for name in found if name in words}
        for first, cells in _blocks(path, rows, names):
            for name in found:
                column = _codes(cells[name], index[name]) if name in index else _floats(path, name, cells[name], first)
                found[name].append(column)
    joined = {name: np.concatenate([np.empty(0), *parts]) for name, parts in found.items()}
    return {
        name: Words(column.astype(np.int64), tuple(index[name])[1:]) if name in index else column
        for name, column in joined.items()
    }


def _blocks(
    path: Path, rows: Iterator[list[str]], names: Sequence[str]
) -> Iterator[tuple[int, Mapping[str, tuple[str, ...]]]]:
    """Yield the number of the first row and the cells by column of consecutive blocks of rows.

    Raises:
        FileError: if a row is incomplete.
    """
    first = 1
    filled = filter(None, rows)
    while block := list(islice(filled, _BLOCK_ROWS)):
        for number, row in enumerate(block, first):
            if len(row) != len(names):
                raise FileError(
                    f"{path}, row {number}: expected {len(names)} cells, got {len(row)}. Is the file truncated?"
                )
        yield first, dict(zip(names, zip(*block, strict=True), strict=True))
        first += len(block)


def _codes(cells: Sequence[str], index: dict[str, int]) -> np.ndarray:
    """Return the codes of words, to which new words are added; the empty word, the first, has the code -1."""
    return np.array([index.setdefault(cell, len(index) - 1) for cell in cells], dtype=np.float64)


def _floats(path: Path, name: str, cells: Sequence[str], first: int) -> np.ndarray:
    try:
        # Python accepts underscores in numbers, CSV files do not.
        if "_" not in "".join(cells):
            return np.array([float(cell or "nan") for cell in cells])
    except ValueError:
        pass
    row, cell = next((first + i, cell) for i, cell in enumerate(cells) if not _is_number(cell))
    raise FileError(f"{path}, row {row}: the column {name} does not contain numbers: {cell[:40]!r}.")


def _is_number(cell: str) -> bool:
    try:
        return "_" not in cell and float(cell or "nan") is not None
    except ValueError:
        return False
