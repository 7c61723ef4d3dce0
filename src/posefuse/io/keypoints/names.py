"""Names of views and recordings from file names."""

import glob
import re
from collections.abc import Collection, Sequence
from itertools import takewhile
from pathlib import Path

from posefuse.errors import FileError, choices
from posefuse.io.files import natural_key
from posefuse.model.view_names import plain_name

_SEPARATORS = "_. "


def view_names(files: Sequence[Path]) -> list[str]:
    """Return the name of the view of each file.

    If every file has its own folder, that is the name of the folder. Otherwise it is the part in which the file names
    differ, delimited by underscores, dots or spaces: ``trial_Cam-A_dlc.csv`` and ``trial_Cam-B_dlc.csv`` are the views
    Cam-A and Cam-B.

    Raises:
        FileError: If the files belong to more than one trial.
    """
    if len({file.parent for file in files}) == len(files) > 1:
        return [file.parent.name for file in files]
    stems = [file.name.split(".csv")[0].split(".analysis")[0].removesuffix(".h5") for file in files]
    if len(stems) == 1:
        return stems
    start = _at_separator(_common_start(stems))
    # The views cam_1 and cam_2 are not called 1 and 2.
    word = re.search(r"(cam|camera|view)[_. ]$", stems[0][:start], re.IGNORECASE)
    start = word.start() if word and not any(stem[start:].lower().startswith("cam") for stem in stems) else start
    end = _at_separator(_common_start([stem[start:][::-1] for stem in stems]))
    names = [stem[start : len(stem) - end] for stem in stems]
    if any(not name or set(_SEPARATORS) & set(name[word.end() - word.start() if word else 0 :]) for name in names):
        several = "".join(f"\n  `keypoints={str(files[0].parent / pattern)!r}`" for pattern in recordings_in(files))
        raise FileError(
            f"{files[0].parent} contains files whose names differ in more than the camera: {choices(stems)}. "
            + (f"Choose one of the recordings:{several}" if several else "Keep one file per camera in a folder.")
        )
    return names


def recordings_in(files: Sequence[Path], cameras: Collection[str] = ()) -> list[str]:
    """Return file name patterns of the recordings in a folder with several recordings of the same cameras.

    Names are split at ``_ . -`` and spaces. If they differ in one part, that is the camera, and there is one recording.
    If they differ in several parts, the camera is the part that is always the name of a camera, or that contains or
    follows ``cam``.

    Args:
        files: Files of one folder.
        cameras: Names of the calibrated cameras, if available.

    Returns:
        One pattern per recording with ``*`` for the camera. Empty if the names are ambiguous.
    """
    split_names = [re.split(r"([_.\- ]+)", file.name) for file in files]
    if len({len(parts) for parts in split_names}) != 1:
        return []
    differ = [i for i in range(0, len(split_names[0]), 2) if len({parts[i] for parts in split_names}) > 1]
    if len(differ) > 1:
        calibrated = {_plain(camera) for camera in cameras}
        with_camera_name = [i for i in differ if all(_plain(parts[i]) in calibrated for parts in split_names)]
        with_cam = [i for i in differ if all("cam" in _with_previous(parts, i).lower() for parts in split_names)]
        differ = with_camera_name or with_cam
    if len(differ) != 1:
        return []
    at = differ[0]
    patterns = {"".join("*" if i == at else glob.escape(part) for i, part in enumerate(parts)) for parts in split_names}
    return sorted(patterns, key=natural_key)


def _with_previous(parts: Sequence[str], at: int) -> str:
    """Return a part of a name together with the previous part."""
    return "".join(parts[max(at - 2, 0) : at + 1])


def _plain(word: str) -> str:
    return plain_name(word).removeprefix("cam")


def _common_start(texts: Sequence[str]) -> str:
    equal = takewhile(lambda letters: len(set(letters)) == 1, zip(*texts, strict=False))
    return "".join(letters[0] for letters in equal)


def _at_separator(common: str) -> int:
    """Return the length of a common part up to and including its last separator."""
    return max(common.rfind(separator) for separator in _SEPARATORS) + 1
