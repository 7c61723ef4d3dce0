"""File access shared by all readers and writers: existence checks, safe parsing, atomic replacement."""

import contextlib
import os
import re
import shutil
import tomllib
import zipfile
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from posefuse.errors import FileError, PosefuseError, choices
from posefuse.io.folder_locks import busy_error, exclusive_folder, is_same_folder

_LARGE_BYTES = 256_000_000
_MAX_UNPACKED_RATIO = 200


def must_exist(path: Path, what: str) -> Path:
    """Return the path if it exists, or if it is a pattern that matches files.

    Raises:
        FileError: If it does not exist. The message lists the content of the nearest existing folder.
    """
    if path.exists() or (is_pattern(path) and files_at(path)):
        return path
    parent = next((folder for folder in path.parents if folder.is_dir()), Path())
    seen = sorted(entry.name for entry in parent.iterdir() if not entry.name.startswith("."))
    folder = "This folder" if parent == Path() else str(parent)
    content = f"contains: {choices(seen)}" if seen else "is empty"
    raise FileError(f"No {what} at {path}. {folder} {content}.")


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file.

    Raises:
        FileError: If the file cannot be read or is not UTF-8.
    """
    try:
        return path.read_text("utf-8")
    except UnicodeDecodeError as error:
        raise FileError(f"{path} is not a text file in UTF-8 (invalid byte at position {error.start}).") from None
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}.") from None


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Raises:
        FileError: If the file is not valid TOML.
    """
    try:
        return tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise FileError(f"{path} is not valid TOML: {error}. Is the file truncated?") from None


def parse_xml(path: Path, text: str) -> ElementTree.Element:
    """Return the root element of an XML text.

    Entities are refused, because a short text of nested entities expands to any size.

    Raises:
        FileError: If the text is not valid XML or declares entities.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise FileError(f"{path} declares XML entities, which calibrations do not need. The file is not read.")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise FileError(f"{path} is not complete XML: {error}. Is the file truncated?") from None


@contextlib.contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Turn any exception that a library raises on a broken file into a FileError.

    Args:
        path: File that is read inside the ``with`` block.
        what: Kind of file, for the message.

    Raises:
        FileError: If the block raises an exception that is not a PosefuseError.
    """
    try:
        yield
    except PosefuseError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise FileError(f"{path} is not a complete {what}: {reason}. Is the file truncated?") from None


def check_unpacked_size(path: Path, n_bytes: int) -> None:
    """Refuse a decompression bomb: a small file with very large content.

    Args:
        path: Compressed file.
        n_bytes: Size of its content when decompressed.

    Raises:
        FileError: If the content exceeds 256 MB and 200 times the size of the file.
    """
    if n_bytes > max_unpacked_bytes(path):
        raise FileError(
            f"{path} ({path.stat().st_size} bytes) would expand to {n_bytes} bytes. It looks like a decompression "
            "bomb and is not read."
        )


def max_unpacked_bytes(path: Path) -> int:
    """Return the allowed size of a file's decompressed content: 256 MB or 200 times the file, whichever is larger."""
    return max(_LARGE_BYTES, _MAX_UNPACKED_RATIO * path.stat().st_size)


def read_npz(path: Path, names: Collection[str]) -> dict[str, np.ndarray]:
    """Return those of the named arrays that an ``.npz`` file contains.

    Args:
        path: The file.
        names: Names of the arrays to read. Without names, every array of the file is listed and none is read: the
            values are empty arrays.

    Raises:
        FileError: If the file is truncated, is a decompression bomb, or an array holds Python objects.
    """
    with reading(path, "NumPy array file"), zipfile.ZipFile(path) as packed:
        members = [member for member in packed.infolist() if member.filename.endswith(".npy")]
        by_name = {member.filename.removesuffix(".npy"): member for member in members}
        if not names:
            return {name: np.empty(0) for name in by_name}
        requested = {name: member for name, member in by_name.items() if name in names}
        check_unpacked_size(path, sum(member.file_size for member in requested.values()))
        arrays = {}
        for name, member in requested.items():
            with packed.open(member) as content:
                arrays[name] = np.lib.format.read_array(content, allow_pickle=False)
        return arrays


def read_npy(path: Path) -> np.ndarray:
    """Return the array of an ``.npy`` file.

    Raises:
        FileError: If the file is truncated or holds Python objects.
    """
    with reading(path, "NumPy array file"):
        array = np.load(path, allow_pickle=False)
        if not isinstance(array, np.ndarray):
            raise TypeError("it is an archive")
        return array


def files_at(path: Path) -> list[Path]:
    """Return the files that a path stands for, in natural order.

    A path is one file, a folder (its files), or a pattern in place of a name such as ``trial_*_dlc.csv``.
    """
    if path.is_dir():
        entries = list(path.iterdir())
    elif is_pattern(path):
        entries = list(path.parent.glob(path.name))
    else:
        entries = [path]
    return sorted((file for file in entries if file.is_file()), key=lambda file: natural_key(file.name))


def is_pattern(path: Path) -> bool:
    """Return whether a path is a pattern for several files of a folder."""
    return "*" in path.name and path.parent.is_dir() and not path.exists()


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Return a sort key that compares digits as numbers: ``cam_2`` comes before ``cam_10``."""
    return tuple((0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", name) if part)


_MAX_NAME_BYTES = 200
FORBIDDEN_CHARACTERS = re.compile(r'[\x00-\x1f\x7f/\\:*?"<>|\ud800-\udfff]')
"""Characters that at least one file system does not allow in names."""
DEVICE_NAMES = re.compile(r"(?i)(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[\d\xb9\xb2\xb3])\s*(\..*)?", re.DOTALL)
"""Names of devices on Windows. With any extension, they cannot name files."""


def checked_file_name(name: str) -> str:
    """Return a name read from data if it is a valid, harmless name of a file or folder on every system.

    Raises:
        FileError: If the name is not valid everywhere or leads to another folder.
    """
    bad = not name or name != name.strip(" .") or FORBIDDEN_CHARACTERS.search(name) or DEVICE_NAMES.fullmatch(name)
    if bad or len(name.encode()) > _MAX_NAME_BYTES:
        raise FileError(f"{name[:60]!r} is not a valid file name. Rename it in the recording.")
    return name


_NOT_TEXT = re.compile(r"[\x00\ud800-\udfff]")


def check_texts(names: Iterable[str]) -> None:
    """Refuse names with a null character or an unpaired surrogate, which most formats cannot store.

    Raises:
        FileError: With the first such name.
    """
    for name in names:
        if _NOT_TEXT.search(name):
            raise FileError(
                f"The name {name[:60]!r} contains a null character or an unpaired surrogate, which files cannot "
                "store. Rename it in the recording."
            )


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path that replaces ``path`` if the block succeeds and is removed if it fails.

    Raises:
        FileError: If ``path`` is a folder or cannot be written.
    """
    temporary = path.with_name(f".{path.stem}.partial{path.suffix}")
    with writable(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise FileError(f"{path} is a folder. Specify the name of a file.")
    try:
        with writable(path):
            yield temporary
            os.replace(temporary, path)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def writable(path: Path) -> Iterator[None]:
    """Turn an OSError into a FileError that states why the path cannot be written."""
    try:
        yield
    except OSError as error:
        raise FileError(f"{path} cannot be written: {error.strerror or error}. Choose another location.") from None


RESULT_FILES = (
    "reconstruction.nc", "fingerprint.json", "*.csv", "*.csv.gz", "*.trc", "*.c3d", "*.bvh", "*.glb", "report.html",
    "evaluation.json", "debug/*.png",
    "points.parquet", "points*.npz", "points.nwb", "points3d.h5", "points_dlc.h5", "movement.nc",
    "freemocap*/output_data/*/*.npy", "freemocap*/output_data/*.*",
    "opensim/*.trc", "opensim/*.xml", "openpose/*_json/*_keypoints.json",
)  # fmt: skip
"""Patterns of the files of a result folder."""

RUN_FILE = "run.json"
"""File that identifies the output of a run from videos, and states which stages are finished."""

CHECKPOINT_FOLDER = ".parts"
"""Subfolder of a result with the checkpoints of a long reconstruction. See :mod:`posefuse.io.checkpoints`."""


@contextlib.contextmanager
def replacing_folder(
    folder: Path,
    marker: str = RESULT_FILES[0],
    owned: tuple[str, ...] = RESULT_FILES,
    after: contextlib.ExitStack | None = None,
) -> Iterator[Path]:
    """Yield a temporary folder whose files move into ``folder`` if the block succeeds and are removed if it fails.

    Files of an earlier run in ``folder`` (``owned``) are removed before the move. Other files stay.

    Args:
        folder: Destination.
        marker: File that identifies a folder of this kind.
        owned: Patterns of the files of such a folder.
        after: Closed after the move, while the folder is still locked.

    Raises:
        FileError: If ``folder`` is a file, contains other files but not ``marker``, or is being written by another
            process.
    """
    check_folder_marker(folder, marker)
    destination = folder.resolve()
    staging = destination.with_name(f".{destination.name}.partial")
    with contextlib.ExitStack() as cleanup:
        _remove_stale(staging, folder)
        with writable(folder):
            destination.parent.mkdir(parents=True, exist_ok=True)
            try:
                staging.mkdir()
            except FileExistsError:
                raise busy_error(folder) from None
        cleanup.enter_context(exclusive_folder(staging, folder))
        own_staging = staging.stat()

        @cleanup.callback
        def remove_staging() -> None:
            if is_same_folder(staging, own_staging):
                shutil.rmtree(staging, ignore_errors=True)

        yield staging
        # Without locks, another process may have started to write since.
        if not is_same_folder(staging, own_staging):
            raise busy_error(folder)
        with writable(folder):
            _move(staging, destination, marker, owned)
        if after is not None:
            after.close()


def check_folder_marker(folder: Path, marker: str) -> list[str]:
    """Return the names in a folder, after a check that it is absent, empty, or a folder of the marker's kind.

    Raises:
        FileError: If ``folder`` is a file, or contains other files but not ``marker``.
    """
    if folder.exists() and not folder.is_dir():
        raise FileError(f"`output={str(folder)!r}` is a file. Specify a folder.")
    names = sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []
    others = [name for name in names if name != CHECKPOINT_FOLDER]
    # A run that was stopped during the move leaves checkpoints but possibly no marker.
    if others and not (folder / marker).exists() and CHECKPOINT_FOLDER not in names:
        raise FileError(
            f"`output={str(folder)!r}` already contains other files ({choices(others, 5)}) "
            "and is not a result of this command. Choose a new or empty folder."
        )
    return names


def _remove_stale(staging: Path, folder: Path) -> None:
    """Remove the temporary folder of a process that was stopped."""
    if staging.is_dir():
        with exclusive_folder(staging, folder), contextlib.suppress(OSError):
            shutil.rmtree(staging)


def _move(staging: Path, folder: Path, marker: str, owned: tuple[str, ...]) -> None:
    """Move the files, the marker first, so that the folder can always be identified as a result."""
    folder.mkdir(exist_ok=True)
    first = [name for name in dict.fromkeys((marker, RESULT_FILES[0])) if (staging / name).is_file()]
    for name in first:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(staging / name, folder / name)
    for pattern in owned:
        for stale in folder.glob(pattern):
            if stale.relative_to(folder).as_posix() in first:
                continue
            stale.unlink()
            if stale.parent != folder and not any(stale.parent.iterdir()):
                stale.parent.rmdir()
    for entry in sorted(e for e in staging.rglob("*") if e.is_file()):
        target = folder / entry.relative_to(staging)
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(entry, target)
