"""Where compiled kernels are stored: in a folder that the user chooses, beside the code, or in the user's own cache.

Numba uses a folder only if it can write to it. In the image of a container, or where an administrator installs the
package, a user can only read what was compiled before; such folders serve as well.
"""

import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import config
from numba.core.caching import InTreeCacheLocator, UserProvidedCacheLocator, UserWideCacheLocator, ZipCacheLocator

_PACKAGE = Path(__file__).parents[1]


def _chosen() -> str:
    """Return the folder that ``NUMBA_CACHE_DIR`` names, or an empty string."""
    return getattr(config, "CACHE_DIR", "")


class _ReadOnly:
    """A folder that holds a function's compiled code and cannot be written to."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        """Return the locator, or None if the folder does not hold the function."""
        locator = cls(py_func, py_file)  # type: ignore[call-arg]
        name = f"{Path(py_file).stem}.{py_func.__qualname__}-*.nbi"
        try:
            return locator if next(Path(locator.get_cache_path()).glob(name), None) else None  # type: ignore[attr-defined]
        except OSError:
            return None

    def ensure_cache_path(self) -> None:
        """Do nothing: nothing is written."""


class ReadOnlyChosenFolder(_ReadOnly, UserProvidedCacheLocator):
    """The folder that ``NUMBA_CACHE_DIR`` names, where it cannot be written to."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        """Return the locator, or None if no folder is chosen or it does not hold the function."""
        return super().from_function(py_func, py_file) if _chosen() else None


class ReadOnlyPackage(_ReadOnly, InTreeCacheLocator):
    """The folder of the code, where it cannot be written to."""


class Nowhere(ReadOnlyPackage):
    """No folder: kernels can only be loaded from the machine code that the package contains."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        """Return the locator, or None for a function that is not in a file."""
        return cls(py_func, py_file) if Path(py_file).is_file() else None  # type: ignore[call-arg]


LOCATORS = [
    UserProvidedCacheLocator,
    ReadOnlyChosenFolder,
    InTreeCacheLocator,
    ReadOnlyPackage,
    UserWideCacheLocator,
    ZipCacheLocator,
    Nowhere,
]
"""Places for compiled code, in the order in which they are tried for each kernel."""


def is_read_only(locator: Any) -> bool:
    """Return whether a locator's folder cannot be written to."""
    return isinstance(locator, _ReadOnly)


def store_of(kernel: Any) -> tuple[Path | None, bool]:
    """Return the folder of all kernels' machine code, and whether it can be written to; None if nothing is stored.

    Args:
        kernel: any kernel.
    """
    locator = getattr(getattr(getattr(kernel, "_cache", None), "_impl", None), "locator", None)
    if locator is None or isinstance(locator, Nowhere):
        return None, False
    if isinstance(locator, UserProvidedCacheLocator):
        return Path(_chosen()), not is_read_only(locator)
    if isinstance(locator, InTreeCacheLocator):
        return _PACKAGE, not is_read_only(locator)
    return Path(locator.get_cache_path()).parent, True


def check_store(locator: Any) -> bool:
    """Return whether a compiled kernel can be stored at a locator; warn once if there is no folder at all."""
    if isinstance(locator, Nowhere):
        _warn_of_no_store()
    return not is_read_only(locator)


@cache
def _warn_of_no_store() -> None:
    tried = ", ".join(str(path) for path in (_chosen(), _PACKAGE, "the cache of the user") if path)
    warnings.warn(
        f"No folder for compiled kernels is writable ({tried}), so every process compiles again. Set "
        "NUMBA_CACHE_DIR to a writable folder.",
        stacklevel=2,
    )
