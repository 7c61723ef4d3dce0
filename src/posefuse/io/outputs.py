"""The guard of outputs: what exists is replaced only if the caller asks for it, and several files only together."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from posefuse.errors import FileError, OutputExistsError, choices
from posefuse.io.files import check_folder_marker, writable

_MOST_NAMES = 4


def check_new_files(files: Iterable[Path], *, overwrite: bool, target: str = "`output`") -> None:
    """Refuse to replace files.

    Args:
        files: files that are about to be written.
        overwrite: whether the caller asks to replace them.
        target: what names the output, in a message.

    Raises:
        OutputExistsError: if a file exists and is not to be replaced.
    """
    existing = [] if overwrite else [file for file in files if file.is_file()]
    if not existing:
        return
    first, *others = existing
    if not others:
        raise exists_error(f"{first} already exists", target)
    raise exists_error(f"{choices([str(file) for file in existing], _MOST_NAMES)} already exist", target)


def check_new_page(path: Path, *, overwrite: bool) -> None:
    """Refuse to replace a page, or to write one under a name that browsers do not open.

    Raises:
        FileError: if the name does not end in ``.html`` or ``.htm``.
        OutputExistsError: if the file exists and is not to be replaced.
    """
    if path.suffix.lower() not in {".html", ".htm"}:
        raise FileError(f"{path}: the name of the page must end in .html.")
    check_new_files([path], overwrite=overwrite)


def check_new_folder(folder: Path, *, overwrite: bool, marker: str = "", target: str = "`output`") -> None:
    """Refuse to replace the content of a folder.

    Args:
        folder: folder that is about to be written.
        overwrite: whether the caller asks to replace an earlier output in it.
        marker: file that identifies an earlier output of the same kind; a folder with other files and without it is
            never written to. Empty if any content may be replaced.
        target: what names the output, in a message.

    Raises:
        OutputExistsError: if the folder contains an earlier output that is not to be replaced.
        FileError: if it is a file, or contains files of another kind.
    """
    names = check_folder_marker(folder, marker) if marker else _names_in(folder)
    if names and not overwrite:
        names = sorted(names, key=lambda name: name != marker)
        raise exists_error(f"{folder} already contains {choices(names, _MOST_NAMES)}", target)


def exists_error(found: str, target: str = "`output`") -> OutputExistsError:
    """Return the error that an output exists.

    Args:
        found: what exists, as a main clause.
        target: what names the output, in a message.
    """
    return OutputExistsError(f"{found}; give `overwrite=True` to replace it, or choose another {target}.")


def _names_in(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []


@contextlib.contextmanager
def replacing_together(files: Sequence[Path]) -> Iterator[tuple[Path, ...]]:
    """Yield temporary paths that replace the files of one folder, or add to them, if the block succeeds.

    If the block fails, no file of the folder changes. Temporary files have the names of the files that they replace.

    Raises:
        FileError: if the files cannot be written.
    """
    if not files:
        yield ()
        return
    folder = files[0].parent
    with writable(folder):
        folder.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(".partial", ".", folder))
    try:
        with writable(folder):
            staged = tuple(staging / file.name for file in files)
            yield staged
            for temporary, file in zip(staged, files, strict=True):
                os.replace(temporary, file)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
