"""Which recordings a batch is of, and what their results are called."""

from collections.abc import Sequence
from pathlib import Path

from posefuse.errors import OptionsError, choices
from posefuse.model.batch import Job
from posefuse.model.options import Options


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

    Folders are taken once. The batch's own output is no recording, should a pattern name it too.

    Raises:
        OptionsError: if there is no recording, or names cannot be told apart.
    """
    output = output.resolve()
    chosen = list(dict.fromkeys(folder.resolve() for folder in folders))
    chosen = [folder for folder in chosen if folder != output and output not in folder.parents]
    if not chosen:
        raise OptionsError("No recording is given: posefuse batch FOLDER... --output DIR.")
    calibration = None if calibration is None else calibration.resolve()
    names = _names(chosen)
    return [
        Job(name, folder, output / name, calibration, options, again, window_s)
        for name, folder in zip(names, chosen, strict=True)
    ]


def _names(folders: Sequence[Path]) -> list[str]:
    last = [folder.name for folder in folders]
    names = [
        name if last.count(name) == 1 else f"{folder.parent.name}-{name}"
        for name, folder in zip(last, folders, strict=True)
    ]
    for name, folder in zip(names, folders, strict=True):
        if names.count(name) > 1 or not folder.name:
            alike = [str(f) for n, f in zip(names, folders, strict=True) if n == name]
            raise OptionsError(
                f"Results are called after their folders, and these cannot be told apart: {choices(alike, 4)}. Rename "
                "one, or do them in another batch."
            )
    return names
