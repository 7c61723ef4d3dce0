"""Cached machine code of kernels is used only if no source file of any kernel changed.

Numba compares the file of a kernel, but not those of the subroutines that are compiled into it. After an upgrade of the
package that changes only a subroutine, it would execute the machine code of the old version.
"""

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

_FOLDER = Path(__file__).parent


def require_all_sources(dispatcher: Any) -> None:
    """Make the cache of a kernel depend on the sources of all kernels; without a cache, do nothing."""
    file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if file is not None:
        file._source_stamp = (file._source_stamp, digest(_FOLDER))


@cache
def digest(folder: Path) -> str:
    """Return a digest of the names and contents of all Python files below a folder."""
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        found.update(f"{path.relative_to(folder).as_posix()}\0".encode())
        found.update(hashlib.sha256(path.read_bytes()).digest())
    return found.hexdigest()
