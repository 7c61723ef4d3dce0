"""Arrays in the platform's cache folder, found by a digest of everything that they depend on.

The folder is ``$POSEFUSE_CACHE`` if set, else that of the platform. A cache is never needed: what cannot be read or
written is computed again.
"""

import contextlib
import os
from collections.abc import Mapping

import numpy as np

from posefuse.errors import FileError
from posefuse.folders import cache_folder
from posefuse.io.files import read_npz, replacing

_MOST_FILES = 500


def read_cached(kind: str, key: str, names: tuple[str, ...]) -> dict[str, np.ndarray] | None:
    """Return arrays of the cache, or None if they are not there.

    Args:
        kind: name of the folder of such arrays.
        key: digest of what they depend on.
        names: names of the arrays.
    """
    path = cache_folder() / kind / f"{key}.npz"
    try:
        if not path.is_file():
            return None
        arrays = read_npz(path, names)
        with contextlib.suppress(OSError):
            os.utime(path)
    except (OSError, RuntimeError, FileError):
        return None
    return arrays if all(name in arrays for name in names) else None


def write_cached(kind: str, key: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Store arrays in the cache, and remove those that were not used for the longest time if there are many."""
    folder = cache_folder() / kind
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(folder / f"{key}.npz") as temporary, temporary.open("wb") as stream:
            np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
        files = sorted(folder.glob("*.npz"), key=lambda file: file.stat().st_mtime_ns)
        for file in files[:-_MOST_FILES]:
            file.unlink(missing_ok=True)
    except (OSError, RuntimeError, FileError):
        return
