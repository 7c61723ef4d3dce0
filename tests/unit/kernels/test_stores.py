"""Compiled kernels are read from folders that cannot be written to, and compiled in memory where none is usable."""

import os
import subprocess
import sys

import pytest

# Tests may run as a user who can write everywhere.
CALL = """
import sys
import warnings
from pathlib import Path
from numba.core.caching import _CacheLocator

def refuse(self):
    raise PermissionError(13, "Permission denied")

if sys.argv[1] == "read-only":
    _CacheLocator.ensure_cache_path = refuse
sys.path.insert(0, sys.argv[2])
with warnings.catch_warnings(record=True) as given:
    warnings.simplefilter("always")
    import numpy as np
    import kernels
    from posefuse.kernels.stores import store_of
    total = float(kernels.total(np.arange(4.0)))
folder, writable = store_of(kernels.total)
loaded = sum(kernels.total.stats.cache_hits.values())
print(total, loaded, folder and folder.name, writable, sum("No folder for" in str(each.message) for each in given))
"""
KERNELS = """
from posefuse.kernels.jit import kernel


@kernel
def total(values):
    found = 0.0
    for value in values:
        found += value
    return found
"""


@pytest.fixture
def call(tmp_path):
    """Return a function that calls a kernel in a new process, and returns what that prints."""
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "kernels.py").write_text(KERNELS)
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_DISABLE_JIT"}

    def run(mode: str, store: str) -> str:
        chosen = {**environment, "NUMBA_CACHE_DIR": str(tmp_path / store)}
        command = [sys.executable, "-c", CALL, mode, str(tmp_path / "code")]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=chosen).stdout.strip()

    return run


def test_a_folder_that_cannot_be_written_to_is_read(call, tmp_path):
    assert call("writable", "store") == "6.0 0 store True 0"
    stored = sorted((tmp_path / "store").rglob("*"))
    assert call("read-only", "store") == "6.0 1 store False 0"
    assert sorted((tmp_path / "store").rglob("*")) == stored


def test_without_a_usable_folder_a_process_compiles_and_warns_once(call, tmp_path):
    assert call("read-only", "absent") == "6.0 0 None False 1"
    assert not (tmp_path / "absent").exists()


@pytest.mark.parametrize("ending", ["nbc", "nbi"])
@pytest.mark.parametrize("size", [0, 100])
def test_truncated_kernels_are_compiled_again(call, tmp_path, ending, size):
    assert call("writable", "store") == "6.0 0 store True 0"
    files = list((tmp_path / "store").rglob(f"*.{ending}"))
    assert files
    for file in files:
        os.truncate(file, size)
    assert call("read-only", "store") == "6.0 0 store False 0"
    assert call("writable", "store") == "6.0 0 store True 0"
    assert call("writable", "store") == "6.0 1 store True 0"
