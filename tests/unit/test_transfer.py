"""Values sent to another process: equal values, writable arrays, no files left, full folders."""

import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.transfer import Transfer
from tests.properties import examples

TYPES = ("<f8", "<f4", "<f2", "<i8", "|u1", "|b1", "<U3", "<M8[s]", "|O")


@pytest.fixture
def transfer():
    made = Transfer()
    yield made
    made.remove()
    assert not made.folder.exists()


def arrays(rng: np.random.Generator, size: int) -> dict[str, np.ndarray]:
    """Return arrays of all types, orders and strides."""
    numbers = rng.integers(0, 200, (size, 3))
    found = {name: numbers.astype(name) for name in TYPES}
    floats = found["<f8"]
    return {**found, "fortran": np.asfortranarray(floats), "strided": floats[::2, 1:], "empty": floats[:0]}


@given(seed=st.integers(0, 2**31), size=st.sampled_from([1, 3000, 20_000, 60_000]))
@examples(8)
def test_values_arrive_as_they_were(seed, size):
    transfer = Transfer()
    value = arrays(np.random.default_rng(seed), size)
    got, label = transfer.pack((value, "label")).unpack()
    assert label == "label"
    assert list(got) == list(value)
    for name, array in value.items():
        assert got[name].dtype == array.dtype
        np.testing.assert_array_equal(got[name], array)
    assert not transfer.folder.exists() or list(transfer.folder.iterdir()) == []
    transfer.remove()


@pytest.mark.parametrize("size", [10, 1_000_000])
def test_arrays_can_be_changed_without_effect_on_the_sender(transfer, size):
    numbers = np.zeros(size)
    got = transfer.pack(numbers).unpack()
    got += 1.0
    assert (got == 1.0).all()
    assert (numbers == 0.0).all()


def test_arrays_are_aligned(transfer):
    value = [np.zeros(100_001, dtype=np.uint8), np.zeros(200_000), np.zeros(70_003, dtype=np.uint8), np.ones(9000)]
    for array in transfer.pack(value).unpack():
        assert array.ctypes.data % 64 == 0


def test_values_that_do_not_fit_in_the_folder_go_without_it(transfer, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fdopen", full)
    numbers = np.arange(1_000_000.0)
    np.testing.assert_array_equal(transfer.pack(numbers).unpack(), numbers)
    assert list(transfer.folder.iterdir()) == []
