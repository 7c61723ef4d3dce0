"""Heaps of texts in HDF5 files are found wherever they lie, a window at a time."""

import h5py
import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io import hdf5_heaps


@pytest.mark.parametrize("window", [8, 9, 13, 64, 1 << 24])
def test_collections_are_found_across_windows(tmp_path, monkeypatch, window):
    monkeypatch.setattr(hdf5_heaps, "_WINDOW", window)
    content = bytearray(np.random.default_rng(0).integers(0, 256, 400, dtype=np.uint8))
    places = [0, 57, 65, 130, 391]
    for place in places:
        content[place : place + 8] = b"GCOL\x01\0\0\0"
    path = tmp_path / "some"
    path.write_bytes(content)
    with path.open("rb") as file:
        assert list(hdf5_heaps._collections(file)) == places


def test_a_broken_heap_is_said_and_a_whole_one_is_not(tmp_path):
    path = tmp_path / "texts.h5"
    with h5py.File(path, "w") as file:
        file["names"] = np.array(["one", "two"] * 50, dtype=object)
    hdf5_heaps.check_heaps(path)
    content = bytearray(path.read_bytes())
    place = content.index(b"GCOL")
    content[place + 24 : place + 32] = (1 << 40).to_bytes(8, "little")
    path.write_bytes(content)
    with pytest.raises(FileError, match="texts at byte"):
        hdf5_heaps.check_heaps(path)
