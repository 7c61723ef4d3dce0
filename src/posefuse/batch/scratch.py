"""Temporary folders for copies of what lies on object stores; those of processes that died are removed."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from posefuse.errors import FileError
from posefuse.io.folder_locks import exclusive_folder

_ATTEMPTS = 5


@contextlib.contextmanager
def scratch_folder() -> Iterator[Path]:
    """Yield an empty folder in the folder for temporary files (``TMPDIR``), which is removed at the end."""
    base = Path(tempfile.gettempdir()) / f"posefuse-{os.getuid() if hasattr(os, 'getuid') else 'scratch'}"
    base.mkdir(mode=0o700, exist_ok=True)
    _remove_abandoned(base)
    with contextlib.ExitStack() as cleanup:
        folder = _locked(base, cleanup)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def require_space(folder: Path, n_bytes: int, what: str) -> None:
    """Refuse a download that does not fit.

    Raises:
        FileError: if the disk of the folder has less free space.
    """
    free = shutil.disk_usage(folder).free
    if n_bytes > free:
        raise FileError(
            f"The copy of {what} takes {n_bytes / 1e9:.1f} GB, but {folder.parent} has {free / 1e9:.1f} GB. Set TMPDIR "
            "to a folder with more space."
        )


def _locked(base: Path, cleanup: contextlib.ExitStack) -> Path:
    """Create and lock a folder; another process may remove it in between."""
    for _ in range(_ATTEMPTS):
        folder = Path(tempfile.mkdtemp(dir=base))
        try:
            cleanup.enter_context(exclusive_folder(folder, folder))
        except FileError:
            continue
        return folder
    raise FileError(f"No folder for temporary files can be created in {base}.")


def _remove_abandoned(base: Path) -> None:
    """Remove the folders of processes that were killed, which no longer hold their locks."""
    try:
        import fcntl  # noqa: F401
    except ImportError:
        return
    for folder in base.iterdir():
        with contextlib.suppress(FileError), exclusive_folder(folder, folder):
            shutil.rmtree(folder, ignore_errors=True)
