"""Formats with a file a camera: which files are of a format, which were meant to be, and reading one after another.

A camera whose file is damaged must not go missing unsaid. So where some files of a folder are of a format, those beside
them that hold nothing, or that end or go wrong in the middle, are read too, which is an error that names them.
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

_MOST_FILES = 300
_LONGEST_LINE = 100_000_000
_PATTERNS = ("*", "*/*")


def _never(_: Path) -> bool:
    return False


@dataclass(frozen=True)
class FileKind:
    """What the files of a format are known by.

    Attributes:
        suffixes: of their names.
        is_one: whether a file with such a suffix is one, by its first bytes.
        was_meant: whether a file that is none was meant to be one: it looks like one, or like one in which nobody is.
    """

    suffixes: tuple[str, ...]
    is_one: Callable[[Path], bool]
    was_meant: Callable[[Path], bool] = _never


def camera_files(path: Path, kind: FileKind) -> list[Path]:
    """Files of one kind, one a camera, in order: the file; those of a folder; or, without any, of the folders in it."""
    if not path.is_dir():
        return [file for file in files_at(path) if file.suffix in kind.suffixes and kind.is_one(file)]
    for pattern in _PATTERNS:
        found = [file for file in _at_most(path, pattern, kind) if kind.is_one(file)]
        if found:
            return _ordered(path, found)
    return []


def all_camera_files(path: Path, kind: FileKind) -> list[Path]:
    """Those files, and what is damaged of those beside them."""
    good = camera_files(path, kind)
    if path.is_file() or not good:
        return good
    if not path.is_dir():
        return [file for file in files_at(path) if file in good or _is_lost(file, kind)]
    if good[0].parent == path:
        others = _at_most(path, "*", kind)
    else:  # of folders, a camera each, those that have no file of the kind
        others = [file for file in _at_most(path, "*/*", kind) if file.parent not in {each.parent for each in good}]
    return _ordered(path, {*good, *(file for file in others if _is_lost(file, kind))})


def _ordered(path: Path, files: Iterable[Path]) -> list[Path]:
    return sorted(files, key=lambda file: natural_key(file.relative_to(path).as_posix()))


def _is_lost(file: Path, kind: FileKind) -> bool:
    """Whether a file that is none of a kind is a camera's all the same."""
    return file.suffix in kind.suffixes and (is_damaged(file) or kind.was_meant(file))


def _at_most(path: Path, pattern: str, kind: FileKind) -> list[Path]:
    """Files with the suffixes, but for hidden ones; none where there are so many that they are frames, not cameras."""
    found = [file for file in path.glob(pattern) if file.suffix in kind.suffixes and not file.name.startswith(".")]
    return [file for file in found if file.is_file()] if len(found) <= _MOST_FILES else []


def is_damaged(file: Path) -> bool:
    """Whether a file is not what its suffix says at all: empty, JSON that ends too soon, texts with binary in them."""
    try:
        if file.stat().st_size == 0:
            return True
        if file.suffix in (".h5", ".slp"):
            return not _opens(file)
        with file.open("rb") as content:
            start = content.read() if file.suffix == ".json" else content.readline(_LONGEST_LINE)
    except OSError:
        return True
    return not _is_json(start) if file.suffix in (".json", ".jsonl") else b"\0" in start


def _is_json(text: bytes) -> bool:
    try:
        msgspec.json.decode(text, type=msgspec.Raw)
    except (msgspec.DecodeError, RecursionError):
        try:
            json.loads(text)  # takes NaN, which some programs write
        except (ValueError, RecursionError):
            return False
    return True


def _opens(file: Path) -> bool:
    """Whether an HDF5 file can be opened."""
    try:
        h5py.File(file, "r").close()
    except (OSError, KeyError, ValueError, RuntimeError):
        return False
    return True


def read_views(
    path: Path, kind: FileKind, request: Request, read_one: Callable[[Path, str], ViewColumns]
) -> list[ViewColumns]:
    """Read a recording's files, one a camera.

    Args:
        path: of the recording.
        kind: of the files.
        request: whose progress is told.
        read_one: makes a view of a file and the view's name.

    Raises:
        FileError: if a file is damaged, or the files' names do not tell the cameras.
    """
    files = all_camera_files(path, kind)
    request.progress.start("reading keypoints", len(files))
    views = []
    for file, name in zip(files, view_names(files), strict=True):
        views.append(read_one(file, name))
        request.progress.advance(1)
    request.progress.finish()
    return views
