"""Which recordings a batch is of, and what their results are called."""

import os
from collections.abc import Sequence
from pathlib import Path

from posefuse.batch.fingerprints import MARK, RESULT
from posefuse.errors import OptionsError, choices
from posefuse.io.files import PARTS
from posefuse.model.batch import Job
from posefuse.model.options.options import Options

TABLE, PAGE = "batch.csv", "batch.html"
RESERVED = (TABLE, PAGE)
"""Of the batch, beside the folders of results."""


def jobs_of(
    folders: Sequence[Path],
    output: Path,
    calibration: Path | None,
    options: Options,
    *,
    again: bool = False,
    window_s: float | None = None,
) -> list[Job]:
    """A job for each recording, named after its folder; after the folder above too where names are not unique.

    Folders are taken once. The batch's own output is no recording, should a pattern name it too, nor are results in it.

    Raises:
        OptionsError: if there is no recording, one lies in the output, or names cannot be told apart.
    """
    if not folders:
        raise OptionsError("No recording is given: posefuse batch FOLDER... --output DIR.")
    place = output.resolve()
    chosen = [folder for folder in dict.fromkeys(f.resolve() for f in folders) if not _is_result(folder, place)]
    inside = [str(folder) for folder in chosen if place in folder.parents]
    if inside:
        raise OptionsError(f"--output {output} holds recordings of the batch ({choices(inside, 4)}). Choose another.")
    if not chosen:
        raise OptionsError(f"All that is given is the output itself or a result in it: {output}. Give recordings.")
    calibration = None if calibration is None else calibration.resolve()
    names = _names(chosen)
    return [
        Job(name, folder, place / name, calibration, options, again, window_s)
        for name, folder in zip(names, chosen, strict=True)
    ]


def _is_result(folder: Path, output: Path) -> bool:
    """Whether a folder is the batch's output, or what a batch made or was about to make there."""
    if folder == output:
        return True
    made = any((folder / name).exists() for name in (RESULT, MARK, PARTS)) or folder.name.endswith(".partial")
    return output in folder.parents and made


def _name_of(folder: Path) -> str:
    """A folder's name as text: bytes that are none are spelled out."""
    return os.fsencode(folder.name).decode("utf-8", "backslashreplace")


def _names(folders: Sequence[Path]) -> list[str]:
    last = [_name_of(folder) for folder in folders]
    names = [
        name if last.count(name) == 1 else f"{_name_of(folder.parent)}-{name}"
        for name, folder in zip(last, folders, strict=True)
    ]
    for name, folder in zip(names, folders, strict=True):
        if names.count(name) > 1 or not folder.name:
            alike = [str(f) for n, f in zip(names, folders, strict=True) if n == name]
            raise OptionsError(
                f"Results are called after their folders, and these cannot be told apart: {choices(alike, 4)}. Rename "
                "one, or do them in another batch."
            )
        if name in RESERVED or name.startswith("."):
            raise OptionsError(f"{folder}: its result would be called {name}, which is not for a recording. Rename it.")
    return names
