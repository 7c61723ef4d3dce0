"""Locks of folders: two processes never write to one output."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from posefuse.errors import FileError


@contextlib.contextmanager
def exclusive_folder(locked: Path, folder: Path) -> Iterator[None]:
    """Lock a folder for this process while the block runs.

    This is an advisory lock of the operating system, which releases it when the process ends in any way. Without such
    locks (Windows, some network drives), the folder is not locked.

    Args:
        locked: Folder to lock.
        folder: Output folder as the user named it, for the message.

    Raises:
        FileError: If another process holds the lock.
    """
    try:
        import fcntl

        descriptor = os.open(locked, os.O_RDONLY)
    except FileNotFoundError:
        raise busy_error(folder) from None
    except (ImportError, OSError):
        yield
        return
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise busy_error(folder) from None
        except OSError:
            pass
        # The previous owner may have removed the folder, and another process may have recreated it since.
        if not is_same_folder(locked, os.fstat(descriptor)):
            raise busy_error(folder)
        yield
    finally:
        os.close(descriptor)


def is_same_folder(path: Path, expected: os.stat_result) -> bool:
    """Return whether a path is still the folder of which the status was read."""
    try:
        return os.path.samestat(path.stat(), expected)
    except FileNotFoundError:
        return False


def busy_error(folder: Path) -> FileError:
    """Return the error that another process writes to a folder."""
    return FileError(
        f"`output={str(folder)!r}`: another posefuse process is writing to this folder. Wait for it, stop it, or "
        "choose another folder."
    )
