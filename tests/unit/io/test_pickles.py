"""Pickles are read without executing code and without allocating memory for memo indices."""

import pickle
from pathlib import Path

import pytest

from posefuse.io.pickles import load_plain


class _CreatesFile:
    """An object whose pickle creates a file when the standard library loads it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> object:
        return Path.touch, (self.path,)


def test_plain_objects_are_loaded():
    content = [["nose", 1.5, 3], {"a": (True, None)}]
    assert load_plain(pickle.dumps(content)) == content


def test_pickles_execute_nothing(tmp_path):
    content = pickle.dumps([_CreatesFile(tmp_path / "created")])
    with pytest.raises(pickle.UnpicklingError, match="only numbers and strings are read"):
        load_plain(content)
    assert not (tmp_path / "created").exists()
    pickle.loads(content)
    assert (tmp_path / "created").exists(), "the file no longer shows why pickle.load is not used"


def test_large_memo_indices_are_refused():
    with pytest.raises(ValueError, match="allocates memory for 4000000000 values"):
        load_plain(b"]r" + (4_000_000_000).to_bytes(4, "little") + b".")
