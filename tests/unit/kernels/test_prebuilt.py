"""Machine code of the package is used only where it fits, and computes what kernels compiled on the machine compute."""

import os
import platform
import subprocess
import sys

import pytest

from posefuse.kernels.prebuilt import COMPILER_VARIABLES

pytestmark = pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64"), reason="The machine code is for processors of another architecture."
)

KERNELS = """
from posefuse.kernels.jit import kernel


@kernel
def squares(values):
    found = 0.0
    for value in values:
        found += value * value
    return found
"""
PROGRAM = """
import sys
import warnings
from pathlib import Path

mode, package, code = sys.argv[1], Path(sys.argv[2]), sys.argv[3]
sys.path.insert(0, code)
import numpy as np
from posefuse.kernels import prebuilt

prebuilt.FOLDER = package
if mode == "other sources":
    prebuilt.digest = lambda folder: "other"
if mode == "another processor":
    prebuilt._FEATURES += ("of no processor",)
if mode == "another Numba":
    import numba

    numba.__version__ = "0.0"
if mode == "another llvmlite":
    prebuilt.llvmlite.__version__ = "0.0"
if mode == "no store":
    from numba.core.caching import _CacheLocator

    def refuse(self):
        raise PermissionError(13, "Permission denied")

    _CacheLocator.ensure_cache_path = refuse
with warnings.catch_warnings(record=True) as given:
    warnings.simplefilter("always")
    import kernels
    total = float(kernels.squares(np.arange(4.0)))
if mode == "export":
    print(prebuilt.export([kernels.squares], package))
else:
    print(total, sum(kernels.squares.stats.cache_hits.values()), len(given))
"""


@pytest.fixture
def call(tmp_path):
    """Return a function that calls a kernel in a new process, and returns what that prints."""
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "kernels.py").write_text(KERNELS)
    (tmp_path / "package").mkdir()

    def run(mode: str, **variables: str) -> list[str]:
        # Options of the test run, such as bounds checks, would make the code unusable.
        kept = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
        environment = {**kept, "NUMBA_CACHE_DIR": str(tmp_path / "store"), **variables}
        command = [sys.executable, "-c", PROGRAM, mode, str(tmp_path / "package"), str(tmp_path / "code")]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout.split()

    assert run("export", **COMPILER_VARIABLES, NUMBA_CACHE_DIR=str(tmp_path / "build")) == ["1"]
    return run


def test_machine_code_of_the_package_is_loaded_and_nothing_is_stored(call, tmp_path):
    assert call("as it is") == ["14.0", "1", "0"]
    assert not list((tmp_path / "store").rglob("*.nbc"))


@pytest.mark.parametrize("mode", ["other sources", "another processor", "another Numba", "another llvmlite"])
def test_code_that_does_not_fit_is_compiled_and_stored(mode, call, tmp_path):
    assert call(mode) == ["14.0", "0", "0"]
    assert list((tmp_path / "store").rglob("*.nbc"))
    assert call(mode) == ["14.0", "1", "0"]


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("BOUNDSCHECK", "1"),
        ("OPT", "1"),
        ("OPT", "max"),
        ("LOOP_VECTORIZE", "0"),
        ("ENABLE_AVX", "0"),
        ("CPU_NAME", ""),
    ],
)
def test_options_of_the_compiler_are_respected(option, value, call):
    assert call("as it is", **{f"NUMBA_{option}": value}) == ["14.0", "0", "0"]


def test_a_package_without_a_store_warns_only_if_it_compiles(call, tmp_path):
    assert call("no store") == ["14.0", "1", "0"]
    for path in (tmp_path / "package").glob("*.nbc"):
        path.unlink()
    assert call("no store") == ["14.0", "0", "1"]
    assert not (tmp_path / "store").exists()


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_truncated_code_is_compiled(ending, call, tmp_path):
    for path in (tmp_path / "package").glob(f"*.{ending}"):
        os.truncate(path, 10)
    assert call("as it is") == ["14.0", "0", "0"]
    assert call("as it is") == ["14.0", "1", "0"]
