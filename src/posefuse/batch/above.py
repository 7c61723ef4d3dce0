"""What belongs to a recording on an object store but lies in the folders above it: settings, and calibrations.

The rules are those of local folders: settings up to four levels above, a calibration or images of a board in a folder
``calib*`` up to two levels above. The calling machine lists these folders once for all recordings.
"""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from posefuse.batch.scratch import require_space, scratch_folder
from posefuse.errors import PosefuseError, PosefuseWarning
from posefuse.io.board_images import PICTURE_ENDINGS, is_board_folder
from posefuse.io.board_specs import find_board_spec
from posefuse.io.object_stores import download, joined, list_entries, list_files, name_of, parents_of, upload
from posefuse.io.recording import CALIBRATION_FILE, find_recording
from posefuse.io.videos.reader import VIDEO_ENDINGS
from posefuse.model.batch import Job, StoredFile
from posefuse.pipeline.calibrate_recording import calibrate_images
from posefuse.progress import Progress

_SETTINGS = (
    "board.toml", "charuco.toml", "Config.toml", "config.toml", "sessionMetadata.yaml", "recording_parameters.json",
)  # fmt: skip
_SETTINGS_LEVELS = 4
_CALIBRATION_LEVELS = 2
_IMAGES = (*VIDEO_ENDINGS, *PICTURE_ENDINGS)


def with_files_above(jobs: Sequence[Job], board: str | None, progress: Progress) -> list[Job]:
    """Return jobs with the files above their recordings, and calibrate by images of a board there, once for all.

    The calibration is uploaded beside the images, where the recordings of the session find it. If the images do not
    determine the cameras, a warning says so, and recordings without another calibration fail.

    Args:
        jobs: jobs of a batch; those of local recordings are returned as they are.
        board: description of the board, or its file; None to use the one beside the images.
        progress: receives the progress.

    Raises:
        StoreError: if a store has no such bucket, does not answer, or denies access.
    """
    known: dict[str, tuple[list[StoredFile], list[str]]] = {}
    files: dict[str, tuple[StoredFile, ...]] = {}

    def above(parent: str, job: Job) -> tuple[StoredFile, ...]:
        if parent not in files:
            settings, folders = _entries_above(joined(parent, "recording"), known)
            inside = [_calibrated(folder, board, job, progress) for folder in folders]
            files[parent] = (*settings, *(file for group in inside for file in group))
        return files[parent]

    return [
        replace(job, above=above(parents_of(job.folder)[0], job)) if isinstance(job.folder, str) else job
        for job in jobs
    ]


def _entries_above(
    url: str, known: dict[str, tuple[list[StoredFile], list[str]]]
) -> tuple[list[StoredFile], list[str]]:
    """Return settings and folders of calibrations above a recording."""
    settings, folders = [], []
    for level, parent in enumerate(parents_of(url)[:_SETTINGS_LEVELS]):
        if parent not in known:
            names, entries = list_entries(parent)
            calibrations = [joined(parent, name) for name in names if is_board_folder(name, alone=True)]
            known[parent] = [file for file in entries if name_of(file.url) in _SETTINGS], calibrations
        settings += known[parent][0]
        folders += known[parent][1] if level < _CALIBRATION_LEVELS else []
    return settings, folders


def _calibrated(folder: str, board: str | None, job: Job, progress: Progress) -> list[StoredFile]:
    """Return the files of a folder of calibrations that recordings need, after a calibration if there is none."""
    inside = list(list_files(folder).values())
    images = [file for file in inside if file.url.lower().endswith(_IMAGES)]
    others = [file for file in inside if file not in images]
    if job.run is not None:
        # A run calibrates by the images itself, unless there is a calibration.
        wanted = job.run.calibration == "board" or not _has_calibration(folder, others)
        return inside if wanted else others
    if not images or _has_calibration(folder, others):
        return others
    with scratch_folder() as scratch:
        require_space(scratch, sum(file.size for file in inside), folder)
        download({_copy_of(file.url, scratch): file for file in inside})
        place = _copy_of(folder, scratch)
        spec = board or find_board_spec((place,))
        if spec is not None:
            try:
                made = calibrate_images(place, spec, place / CALIBRATION_FILE, progress)
                upload({joined(folder, file.name): file for file in (made.with_suffix(".html"), made)})
            except PosefuseError as error:
                why = str(error).replace(str(place), folder)
                warnings.warn(f"The cameras were not calibrated: {why}", PosefuseWarning, stacklevel=2)
    return [file for file in list_files(folder).values() if file not in images]


def _has_calibration(folder: str, files: Sequence[StoredFile]) -> bool:
    """Return whether a recording would find a calibration among files of the folder."""
    with scratch_folder() as scratch:
        download({_copy_of(file.url, scratch): file for file in files})
        recording = _copy_of(folder, scratch).parent / "recording"
        recording.mkdir(parents=True)
        return bool(find_recording(recording).calibrations)


def _copy_of(url: str, root: Path) -> Path:
    return root.joinpath(*url.partition("://")[2].split("/"))
