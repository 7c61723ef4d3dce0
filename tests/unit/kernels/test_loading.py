"""Kernels that are loaded from the cache compute the same, for Python and for kernels that are compiled later."""

import os
import subprocess
import sys

import pytest

KERNELS = """
import numpy as np

from posefuse.kernels.jit import kernel, subroutine


@subroutine
def third(value):
    return value / 3.0


@kernel
def thirds(values):
    found = np.empty(len(values))
    for k in range(len(values)):
        found[k] = third(values[k])
    return found


@kernel
def sum_of_thirds(values):
    total = 0.0
    for value in thirds(values):
        total += value
    return total
"""
CALL = """
import sys
sys.path.insert(0, "{folder}")
import numpy as np
import kernels
found = kernels.{kernel}(np.arange(4.0))
print(float(np.sum(found)), sum(kernels.{kernel}.stats.cache_hits.values()), "numba.np.linalg" in sys.modules)
"""


@pytest.fixture
def called(tmp_path):
    """Return a function that calls a kernel in a new process, and returns what that prints."""
    (tmp_path / "kernels.py").write_text(KERNELS)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment.pop("NUMBA_DISABLE_JIT", None)

    def call(kernel: str) -> list[str]:
        command = [sys.executable, "-c", CALL.format(folder=tmp_path, kernel=kernel)]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout.split()

    return call


def test_loaded_kernel_needs_no_implementations_of_operations(called):
    assert called("thirds") == ["2.0", "0", "True"]
    assert called("thirds") == ["2.0", "1", "False"]


def test_loaded_kernel_is_linked_into_one_that_is_compiled(called):
    assert called("thirds") == ["2.0", "0", "True"]
    assert called("sum_of_thirds") == ["2.0", "0", "True"]
    assert called("sum_of_thirds") == ["2.0", "1", "False"]
