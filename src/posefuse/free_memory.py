"""Memory that the C library keeps after objects are freed."""

import ctypes
import sys
from functools import cache


def release_free_memory() -> None:
    """Return free memory to the operating system; do nothing where the C library offers no such function.

    glibc keeps the memory of freed arrays below 32 MB for the thread that allocated them. Threads of one process that
    handle large ranges of frames in turn would otherwise keep several times what is in use.
    """
    trim = _trim()
    if trim is not None:
        trim(0)


@cache
def _trim() -> "ctypes._FuncPointer | None":
    """Return ``malloc_trim`` of glibc, or None."""
    if not sys.platform.startswith("linux"):
        return None
    return getattr(ctypes.CDLL(None), "malloc_trim", None)
