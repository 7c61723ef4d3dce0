"""Global heaps of HDF5 files are found across windows, and broken ones are refused."""

import subprocess

import h5py
import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io import hdf5_heaps
from tests.broken import run_library


@pytest.mark.parametrize("window", [8, 9, 13, 64, 1 << 24])
def test_collections_are_found_across_windows(tmp_path, monkeypatch, window):
    monkeypatch.setattr(hdf5_heaps, "_WINDOW_BYTES", window)
    content = bytearray(np.random.default_rng(0).integers(0, 256, 400, dtype=np.uint8))
    offsets = [0, 57, 65, 130, 391]
    for offset in offsets:
        content[offset : offset + 8] = b"GCOL\x01\0\0\0"
    path = tmp_path / "collections"
    path.write_bytes(content)
    with path.open("rb") as file:
        assert list(hdf5_heaps._collections(file)) == offsets


def with_object_size(path, size):
    """Write strings, and change the size of the first one."""
    with h5py.File(path, "w") as file:
        file["names"] = np.array(["one", "two"] * 50, dtype=object)
    hdf5_heaps.check_heaps(path)
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL")
    content[heap + 24 : heap + 32] = size.to_bytes(8, "little")
    path.write_bytes(content)


def test_h5py_never_returns_from_a_broken_heap(tmp_path):
    path = tmp_path / "endless.h5"
    with_object_size(path, 2**64 - 16)
    with pytest.raises(subprocess.TimeoutExpired):
        run_library("import h5py; h5py.File(path)['names'][...]", path, timeout_s=5.0)
    with pytest.raises(FileError, match="strings at byte"):
        hdf5_heaps.check_heaps(path)


def test_heap_with_a_broken_size_is_refused(tmp_path):
    path = tmp_path / "broken.h5"
    with_object_size(path, 1 << 40)
    with pytest.raises(FileError, match="strings at byte"):
        hdf5_heaps.check_heaps(path)
