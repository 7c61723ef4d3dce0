"""Memory that the C library keeps after objects are freed."""

import sys
from pathlib import Path

import numpy as np
import pytest

from posefuse import free_memory

_PIECE_BYTES, _PIECES = 64 * 1024, 3000


@pytest.mark.skipif(free_memory._trim() is None, reason="the C library has no malloc_trim")
def test_memory_between_arrays_in_use_is_returned():
    arrays = [np.ones(_PIECE_BYTES, dtype=np.uint8) for _ in range(_PIECES)]
    # Every tenth array stays, so that the C library cannot return what lies after the last one alone.
    kept = arrays[::10]
    arrays = None
    before = _resident_bytes()
    free_memory.release_free_memory()
    assert before - _resident_bytes() > 0.8 * 0.9 * _PIECE_BYTES * _PIECES
    assert all(each.all() for each in kept)


def test_other_platforms_do_nothing(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    free_memory._trim.cache_clear()
    try:
        free_memory.release_free_memory()
        assert free_memory._trim() is None
    finally:
        free_memory._trim.cache_clear()


def _resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096
