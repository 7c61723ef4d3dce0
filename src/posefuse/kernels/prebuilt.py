"""Machine code that some wheels contain, so that a new installation does not compile the kernels.

``scripts/build_wheel.py`` compiles it for all x86-64 processors with AVX2 and fused multiply-add (microarchitecture
level 3, since 2013). It is used only with the same sources, versions of Numba and Python, and compiler options;
otherwise, kernels are compiled and stored on the machine.
"""

import pickle
import sys
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

from llvmlite import binding
from numba.core import config
from numba.core.caching import IndexDataCacheFile

from posefuse.kernels.compiled_sources import digest

FOLDER = Path(__file__).parent / "machine_code"
COMPILER_VARIABLES = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}
"""Environment variables by which Numba compiles for all of these processors."""
_FEATURES = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
_DEFAULT_OPTIONS = {"CPU_NAME": None, "CPU_FEATURES": None, "BOUNDSCHECK": None, "DEBUGINFO_DEFAULT": None, "OPT": 3}
_TRUNCATED = (pickle.UnpicklingError, EOFError)
_KERNELS = Path(__file__).parent


@cache
def is_usable() -> bool:
    """Return whether the package contains machine code for this processor, these versions, sources and options."""
    index = next(FOLDER.glob("*.nbi"), None)
    if index is None or not _has_default_options():
        return False
    available = binding.get_host_cpu_features()
    try:
        fits = bool(_file(FOLDER, index.stem)._load_index())
    except _TRUNCATED:
        return False
    return fits and all(available.get(feature, False) for feature in _FEATURES)


def holds(function: Callable[..., Any]) -> bool:
    """Return whether the package contains usable machine code of a kernel."""
    return is_usable() and (FOLDER / f"{_name(function)}.nbi").is_file()


def load(function: Callable[..., Any], key: tuple[Any, ...]) -> Any:
    """Return the stored machine code of a kernel, or None if there is none or it is truncated.

    Args:
        function: the kernel's Python function.
        key: Numba's key of the code for this processor: signature, target and source.
    """
    if not holds(function):
        return None
    signature, (triple, *_), source = key
    try:
        return _file(FOLDER, _name(function)).load((signature, (triple, *COMPILER_VARIABLES.values()), source))
    except _TRUNCATED:
        return None


def export(dispatchers: Iterable[Any], folder: Path) -> int:
    """Copy the machine code of kernels from the store of this machine into a folder; return the number of kernels.

    Args:
        dispatchers: compiled kernels.
        folder: an existing folder.
    """
    names = set()
    for dispatcher in dispatchers:
        stored = dispatcher._cache._cache_file
        for key, name in stored._load_index().items():
            _file(folder, _name(dispatcher.py_func)).save(key, stored._load_data(name))
            names.add(_name(dispatcher.py_func))
    return len(names)


def _has_default_options() -> bool:
    """Return whether no environment variable changes what Numba compiles."""
    return all((getattr(config, name) or None) == value for name, value in _DEFAULT_OPTIONS.items())


def _file(folder: Path, name: str) -> IndexDataCacheFile:
    """Return the files of a kernel, which are valid for one version of Numba, Python and all sources."""
    return IndexDataCacheFile(str(folder), name, (sys.version_info[:2], digest(_KERNELS)))


def _name(function: Callable[..., Any]) -> str:
    return f"{function.__module__}.{function.__qualname__}"
