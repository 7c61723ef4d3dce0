"""Machine code that some wheels contain, so that a new installation does not compile the kernels.

``scripts/build_wheel.py`` compiles it for all x86-64 processors with AVX2 and fused multiply-add (microarchitecture
level 3, since 2013). Where it does not fit (:func:`why_unused`), kernels are compiled and stored on the machine.
"""

import pickle
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
from llvmlite import binding
from numba.core import config
from numba.core.caching import IndexDataCacheFile

from posefuse.kernels.compiled_sources import digest

FOLDER = Path(__file__).parent / "machine_code"
COMPILER_VARIABLES = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}
"""Environment variables by which Numba compiles for all of these processors."""
_FEATURES = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt")
_OPTIONS = {
    "BOUNDSCHECK": False, "CPU_FEATURES": None, "CPU_NAME": None, "DEBUGINFO_DEFAULT": False, "ENABLE_AVX": True,
    "EXTEND_VARIABLE_LIFETIMES": False, "LLVM_REFPRUNE_PASS": True, "LOOP_VECTORIZE": True, "SLP_VECTORIZE": False,
}  # fmt: skip
"""Numba's options that change machine code, with the values for which it is compiled."""
_OPT = 3
_UNREADABLE = (pickle.UnpicklingError, EOFError, OSError)
_KERNELS = Path(__file__).parent


@cache
def why_unused() -> str:
    """Return why the machine code of the package is not used; empty if it is.

    It fits one processor architecture, one version of Numba, llvmlite and Python, one state of the sources, and Numba's
    default options.
    """
    index = min(FOLDER.glob("*.nbi"), default=None)
    if index is None:
        return "the package contains none"
    if _numba_options()["DISABLE_JIT"]:
        return "the compiler is switched off (NUMBA_DISABLE_JIT)"
    available = binding.get_host_cpu_features()
    if lacking := [feature for feature in _FEATURES if not available.get(feature, False)]:
        return f"this processor lacks {', '.join(lacking)}"
    if not _has_default_options():
        return "an option of Numba (NUMBA_*) changes machine code"
    try:
        fits = bool(_file(FOLDER, index.stem)._load_index())
    except _UNREADABLE:
        return f"{index} cannot be read"
    return "" if fits else "they are for other versions of Numba, llvmlite or Python, or for other sources"


def is_usable() -> bool:
    """Return whether the package contains machine code that is used."""
    return not why_unused()


def holds(function: Callable[..., Any]) -> bool:
    """Return whether the package contains usable machine code of a kernel."""
    return is_usable() and (FOLDER / f"{_name(function)}.nbi").is_file()


def load(function: Callable[..., Any], key: tuple[Any, ...]) -> Any:
    """Return the stored machine code of a kernel, or None if there is none or it cannot be read.

    Args:
        function: the kernel's Python function.
        key: Numba's key of the code for this processor: signature, target and source.
    """
    if not holds(function):
        return None
    signature, (triple, *_), source = key
    try:
        return _file(FOLDER, _name(function)).load((signature, (triple, *COMPILER_VARIABLES.values()), source))
    except _UNREADABLE:
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
    """Return whether Numba compiles with the options of the machine code."""
    options = _numba_options()
    for name, default in _OPTIONS.items():
        value = options.get(name, default)
        if value is not None if default is None else bool(value) != default:
            return False
    return not options["OPT"].is_opt_max and options["OPT"] == _OPT


def _numba_options() -> Mapping[str, Any]:
    """Return the options of environment variables and configuration files, which Numba sets as attributes."""
    return vars(config)


def _file(folder: Path, name: str) -> IndexDataCacheFile:
    """Return the files of a kernel, which are valid for one version of Numba, llvmlite and Python, and all sources."""
    return IndexDataCacheFile(str(folder), name, (sys.version_info[:2], llvmlite.__version__, digest(_KERNELS)))


def _name(function: Callable[..., Any]) -> str:
    return f"{function.__module__}.{function.__qualname__}"
