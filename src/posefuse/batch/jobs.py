"""The jobs of a batch: its recordings and the names of their results."""

import os
from collections.abc import Sequence
from pathlib import Path

from posefuse.errors import OptionsError, choices
from posefuse.io.files import CHECKPOINT_FOLDER
from posefuse.model.batch import Job, JobTreatment
from posefuse.model.options.options import Options
from posefuse.pipeline.fingerprints import MARK, RESULT

TABLE, PAGE = "batch.csv", "batch.html"
RESERVED = (TABLE, PAGE)
"""Files of the batch, beside the folders of results."""


def jobs_of(
    folders: Sequence[Path],
    output: Path,
    calibration: Path | None,
    options: Options,
    treatment: JobTreatment = JobTreatment(),  # noqa: B008
    *,
    window_s: float | None = None,
) -> list[Job]:
    """Return one job per recording, named after its folder, and after the folder above where names are not unique.

    Repeated folders count once. The batch's output folder and results in it are skipped if a pattern matches them.

    Args:
        folders: folders of the recordings.
        output: folder of the batch.
        calibration: calibration of all recordings, or None.
        options: options of the reconstruction.
        treatment: what happens to earlier and to wrong results.
        window_s: length of the windows into which long recordings are divided, or None.

    Raises:
        OptionsError: if there is no recording, one is inside the output folder, or names are not unique.
    """
    if not folders:
        raise OptionsError("No recording given. Specify at least one folder.")
    place = output.resolve()
    chosen = [folder for folder in dict.fromkeys(f.resolve() for f in folders) if not _is_result(folder, place)]
    inside = [str(folder) for folder in chosen if place in folder.parents]
    if inside:
        raise OptionsError(
            f"`output={str(output)!r}` contains recordings of the batch ({choices(inside, 4)}). Choose another folder."
        )
    if not chosen:
        raise OptionsError(
            f"No folder is a recording: each is the output {output} or a result in it. Specify folders of recordings."
        )
    calibration = None if calibration is None else calibration.resolve()
    names = _names(chosen)
    return [
        Job(name, folder, place / name, calibration, options, treatment, window_s)
        for name, folder in zip(names, chosen, strict=True)
    ]


def _is_result(folder: Path, output: Path) -> bool:
    """Return whether a folder is the batch's output, or a finished or unfinished result in it."""
    if folder == output:
        return True
    marks = (RESULT, MARK, CHECKPOINT_FOLDER)
    made = any((folder / name).exists() for name in marks) or folder.name.endswith(".partial")
    return output in folder.parents and made


def _name_of(folder: Path) -> str:
    """Return a folder's name as text, with undecodable bytes escaped."""
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
                "Each result is named after its recording's folder, but these folders have the same name: "
                f"{choices(alike, 4)}. Rename one, or process it in another batch."
            )
        if name in RESERVED or name.startswith("."):
            raise OptionsError(f"{folder}: the result would be named {name}, which is reserved. Rename the folder.")
    return names
