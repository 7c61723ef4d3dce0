"""The folders of the user's computer in which posefuse keeps files."""

import os
import sys
from pathlib import Path


def cache_folder() -> Path:
    """Return the folder of what can be computed again, which need not exist.

    It is ``$POSEFUSE_CACHE`` if set, else that of the platform.
    """
    given = os.environ.get("POSEFUSE_CACHE")
    return Path(given) if given else _platform_folder()


def home_folder() -> Path:
    """Return the folder of the installed detectors, which need not exist.

    It is ``$POSEFUSE_HOME`` if set, else the platform's cache folder.
    """
    given = os.environ.get("POSEFUSE_HOME")
    return Path(given).absolute() if given else _platform_folder()


def _platform_folder() -> Path:
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "posefuse"
