"""Formats with one file per camera: finding the files and reading them one after another.

A camera with a damaged file must not be dropped silently. If some files of a folder are in a format, empty, truncated
or broken files beside them are therefore read, too, which raises an error that names them.
"""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import h5py
import msgspec

from posefuse.io.files import files_at, natural_key
from posefuse.io.keypoints.columns import ViewColumns
from posefuse.io.keypoints.names import view_names
from posefuse.io.keypoints.request import Request

_MAX_FILES = 300
_MAX_LINE_BYTES = 100_000_000
_PATTERNS = ("*", "*/*")


def _never(_: Path) -> bool:
    return False


@dataclass(frozen=True)
class FileKind:
    """How the files of a format are recognized.

    Attributes:
        suffixes: Suffixes of their names.
        is_valid: Return whether a file with such a suffix is in the format, judged by its first bytes.
        is_similar: Return whether an invalid file was probably meant to be in the format: a file with errors, or
            without people.
    """

    suffixes: tuple[str, ...]
    is_valid: Callable[[Path], bool]
    is_similar: Callable[[Path], bool] = _never


def valid_camera_files(path: Path, kind: FileKind) -> list[Path]:
    """Return the files of a format in natural order: the file, those of a folder, or else those of its subfolders."""
    if not path.is_dir():
        return [file for file in files_at(path) if file.suffix in kind.suffixes and kind.is_valid(file)]
    for pattern in _PATTERNS:
        valid = [file for file in _candidates(path, pattern, kind) if kind.is_valid(file)]
        if valid:
            return _ordered(path, valid)
    return []


def all_camera_files(path: Path, kind: FileKind) -> list[Path]:
    """Return the files of a format and the damaged files beside them, in natural order."""
    valid = valid_camera_files(path, kind)
    if path.is_file() or not valid:
        return valid
    if not path.is_dir():
        return [file for file in files_at(path) if file in valid or _is_damaged_camera(file, kind)]
    if valid[0].parent == path:
        others = _candidates(path, "*", kind)
    else:  # with one folder per camera: the folders without a valid file
        cameras = {each.parent for each in valid}
        others = [file for file in _candidates(path, "*/*", kind) if file.parent not in cameras]
    return _ordered(path, {*valid, *(file for file in others if _is_damaged_camera(file, kind))})


def _ordered(path: Path, files: Iterable[Path]) -> list[Path]:
    return sorted(files, key=lambda file: natural_key(file.relative_to(path).as_posix()))


def _is_damaged_camera(file: Path, kind: FileKind) -> bool:
    """Return whether an invalid file is probably the damaged file of a camera."""
    return file.suffix in kind.suffixes and (is_damaged(file) or kind.is_similar(file))


def _candidates(path: Path, pattern: str, kind: FileKind) -> list[Path]:
    """Return visible files with the suffixes, or none if there are too many to be cameras."""
    files = [file for file in path.glob(pattern) if file.suffix in kind.suffixes and not file.name.startswith(".")]
    return [file for file in files if file.is_file()] if len(files) <= _MAX_FILES else []


def is_damaged(file: Path) -> bool:
    """Return whether a file contradicts its suffix: it is empty, incomplete JSON or HDF5, or text with null bytes."""
    try:
        if file.stat().st_size == 0:
            return True
        if file.suffix in (".h5", ".slp"):
            return not _opens(file)
        with file.open("rb") as content:
            start = content.read() if file.suffix == ".json" else content.readline(_MAX_LINE_BYTES)
    except OSError:
        return True
    return not _is_json(start) if file.suffix in (".json", ".jsonl") else b"\0" in start


def _is_json(text: bytes) -> bool:
    try:
        msgspec.json.decode(text, type=msgspec.Raw)
    except (msgspec.DecodeError, RecursionError):
        try:
            json.loads(text)  # accepts NaN, which some programs write
        except (ValueError, RecursionError):
            return False
    return True


def _opens(file: Path) -> bool:
    """Return whether an HDF5 file can be opened."""
    try:
        h5py.File(file, "r").close()
    except (OSError, KeyError, ValueError, RuntimeError):
        return False
    return True


def read_views(
    path: Path, kind: FileKind, request: Request, read_one: Callable[[Path, str], ViewColumns]
) -> list[ViewColumns]:
    """Read the files of a recording, one per camera.

    Args:
        path: The recording.
        kind: How its files are recognized.
        request: Receives the progress.
        read_one: Function that reads a file as the view with the given name.

    Raises:
        FileError: If a file is damaged, or the file names do not identify the cameras.
    """
    files = all_camera_files(path, kind)
    request.progress.start("reading keypoints", len(files))
    views = []
    for file, name in zip(files, view_names(files), strict=True):
        views.append(read_one(file, name))
        request.progress.advance(1)
    request.progress.finish()
    return views
