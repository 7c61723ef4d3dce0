"""MATLAB level 5 files: the values that SciPy reads, and an error for a file that makes SciPy crash."""

import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from posefuse.errors import FileError
from posefuse.io import matlab
from posefuse.io.matlab import read_mat, variable_names
from tests.broken import run_library


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + b"\0" * (-len(content) % 8)


def nested_cells(path: Path, depth: int) -> Path:
    """Write a variable ``params`` of cells in cells."""
    savemat(path, {"params": 1.0})
    header = path.read_bytes()[:128]
    cell = element(6, struct.pack("<II", 1, 0)) + element(5, struct.pack("<ii", 1, 1)) + element(1, b"")
    outermost = cell[:-8] + element(1, b"params")
    inner = element(14, element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", 0, 0)) + element(1, b""))
    size, heads = len(inner), []
    for level in range(depth):
        head = outermost if level == depth - 1 else cell
        heads.append(struct.pack("<II", 14, len(head) + size) + head)
        size += len(heads[-1])
    path.write_bytes(header + b"".join(reversed(heads)) + inner)
    return path


@pytest.mark.parametrize("compressed", [False, True])
def test_values_equal_those_of_scipy(compressed, tmp_path):
    path = tmp_path / "values.mat"
    values = {"numbers": np.arange(6.0).reshape(2, 3), "integers": np.array([[1, -2]], np.int16), "text": "left"}
    savemat(path, values | {"record": {"K": np.eye(3), "name": "cam"}}, do_compression=compressed)
    actual, expected = read_mat(path, (*values, "record")), loadmat(path)
    np.testing.assert_array_equal(actual["numbers"], expected["numbers"])
    np.testing.assert_array_equal(actual["integers"], expected["integers"])
    assert actual["text"] == expected["text"][0]
    record = actual["record"].item()
    np.testing.assert_array_equal(record["K"], expected["record"]["K"].item())
    assert record["name"] == "cam"
    assert variable_names(path) == {*values, "record"}


def test_scipy_crashes_on_nested_cells(tmp_path):
    path = nested_cells(tmp_path / "nested.mat", 100_000)
    assert run_library("from scipy.io import loadmat; loadmat(path)", path) < 0, "drop posefuse.io.matlab"
    with pytest.raises(FileError, match="cells are nested more than 12 levels deep"):
        read_mat(path, ("params",))


def test_compressed_zeros_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(matlab, "_LARGE_BYTES", 10**6)
    savemat(tmp_path / "a.mat", {"params": np.zeros((1000, 1000))}, do_compression=True)
    with pytest.raises(FileError, match=r"a variable of \d+ bytes expands to more than \d+"):
        read_mat(tmp_path / "a.mat", ("params",))
