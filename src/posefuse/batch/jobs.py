"""The jobs of a batch: its recordings and the names of their results."""

import os
from collections.abc import Sequence
from dataclasses import replace
from glob import glob
from pathlib import Path

from posefuse.batch.stored_result import UPLOAD_MARK
from posefuse.errors import FileError, OptionsError, choices
from posefuse.io.files import CHECKPOINT_FOLDER, RUN_FILE, must_exist
from posefuse.io.object_stores import checked_url, is_url, joined, matching_folders, name_of, parents_of, read_stored
from posefuse.model.batch import Job, JobTreatment, Place
from posefuse.model.options.options import Options
from posefuse.model.options.run import RunOptions
from posefuse.pipeline.fingerprints import MARK, RESULT

TABLE, PAGE = "batch.csv", "batch.html"
RESERVED = (TABLE, PAGE)
"""Files of the batch, beside the folders of results."""


def places_of(texts: Sequence[str]) -> list[Place]:
    """Return the recordings that a user names: paths and URLs, with ``*`` in place of names.

    Raises:
        FileError: if no folder matches a pattern.
        StoreError: if an object store does not answer, or denies access.
    """
    found: list[Place] = []
    for text in texts:
        if is_url(text):
            url = checked_url(text)
            found += matching_folders(url) if "*" in url else [url]
        else:
            path = Path(text)
            found += [path] if "*" not in text or path.exists() else _matching_paths(text)
    return found


def _matching_paths(pattern: str) -> list[Path]:
    """Return the folders that match a quoted pattern, in order.

    Raises:
        FileError: if there is none.
    """
    found = [path for path in map(Path, sorted(glob(pattern))) if path.is_dir()]
    if not found:
        raise FileError(f"No folder matches {pattern}.")
    return found


def place_of(text: str) -> Place:
    """Return a path, or a URL without a slash at its end."""
    return checked_url(text) if is_url(text) else Path(text)


def resolved_run(run: RunOptions, folders: Sequence[Place]) -> RunOptions:
    """Return options of a run whose files have absolute paths, because workers run in other folders.

    Files in a recording keep their names, which are relative to each recording.
    """

    def resolved(text: str) -> str:
        inside = any(isinstance(folder, Path) and (folder / text).exists() for folder in folders)
        return text if is_url(text) or inside or not Path(text).exists() else str(Path(text).resolve())

    names = ("calibration", "board", "intrinsics", "keypoints", "timestamps", "synchronize")
    given = {name: getattr(run, name) for name in names}
    files = {name: resolved(text) for name, text in given.items() if text}
    detect = run.detect
    detector = detect.detector
    if detector is not None and detector.endswith((".py", ".toml")):
        detector = resolved(detector)
    weights = tuple(resolved(file) for file in detect.weights)
    return replace(run, **files, detect=replace(detect, detector=detector, weights=weights))


def jobs_of(
    folders: Sequence[Place],
    output: Place,
    calibration: Place | None,
    options: Options,
    treatment: JobTreatment = JobTreatment(),  # noqa: B008
    *,
    window_s: float | None = None,
    run: RunOptions | None = None,
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
        run: options of a run from videos; None to reconstruct from 2D keypoints.

    Raises:
        OptionsError: if there is no recording, one is inside the output folder, or names are not unique.
    """
    if not folders:
        raise OptionsError("No recording given. Specify at least one folder.")
    place = _resolved(output)
    chosen = [folder for folder in dict.fromkeys(map(_resolved, folders)) if not _is_result(folder, place)]
    inside = [str(folder) for folder in chosen if _is_inside(folder, place)]
    if inside:
        raise OptionsError(
            f"`output={str(output)!r}` contains recordings of the batch ({choices(inside, 4)}). Choose another folder."
        )
    if not chosen:
        raise OptionsError(
            f"No folder is a recording: each is the output {output} or a result in it. Specify folders of recordings."
        )
    calibration = None if calibration is None else _resolved(calibration)
    names = _names(chosen)
    return [
        Job(name, folder, _inside(place, name), calibration, options, treatment, window_s, run)
        for name, folder in zip(names, chosen, strict=True)
    ]


def checked_calibration(text: str | None) -> Place | None:
    """Return the calibration of all recordings.

    Raises:
        FileError: if a local file does not exist.
    """
    place = None if text is None else place_of(text)
    return must_exist(place, "calibration") if isinstance(place, Path) else place


def _resolved(place: Place) -> Place:
    return place.resolve() if isinstance(place, Path) else place


def _inside(place: Place, name: str) -> Place:
    return place / name if isinstance(place, Path) else joined(place, name)


def _is_inside(folder: Place, output: Place) -> bool:
    if isinstance(folder, Path):
        return isinstance(output, Path) and output in folder.parents
    return output in parents_of(folder)


def _is_result(folder: Place, output: Place) -> bool:
    """Return whether a folder is the batch's output, or a finished or unfinished result in it."""
    if folder == output:
        return True
    if not _is_inside(folder, output):
        return False
    if not isinstance(folder, Path):
        return read_stored(joined(folder, UPLOAD_MARK)) is not None
    marks = (RESULT, MARK, CHECKPOINT_FOLDER, RUN_FILE)
    return any((folder / name).exists() for name in marks) or folder.name.endswith(".partial")


def _name_of(folder: Place) -> str:
    """Return a folder's name as text, with undecodable bytes escaped."""
    return os.fsencode(folder.name).decode("utf-8", "backslashreplace") if isinstance(folder, Path) else name_of(folder)


def _name_above(folder: Place) -> str:
    return _name_of(folder.parent if isinstance(folder, Path) else parents_of(folder)[0])


def _names(folders: Sequence[Place]) -> list[str]:
    last = [_name_of(folder) for folder in folders]
    names = [
        name if last.count(name) == 1 else f"{_name_above(folder)}-{name}"
        for name, folder in zip(last, folders, strict=True)
    ]
    for name, folder in zip(names, folders, strict=True):
        if names.count(name) > 1 or not _name_of(folder):
            alike = [str(f) for n, f in zip(names, folders, strict=True) if n == name]
            raise OptionsError(
                "Each result is named after its recording's folder, but these folders have the same name: "
                f"{choices(alike, 4)}. Rename one, or process it in another batch."
            )
        if name in RESERVED or name.startswith("."):
            raise OptionsError(f"{folder}: the result would be named {name}, which is reserved. Rename the folder.")
    return names
