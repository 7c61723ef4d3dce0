"""What is in this folder? Calibrations and keypoints, found by looking, never guessed between."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posefuse.errors import FileError, PosefuseError, RecordingError
from posefuse.io import timestamps
from posefuse.io.calibration.read import find_format as calibration_format
from posefuse.io.calibration.read import read_cameras
from posefuse.io.files import files_at, must_exist, natural_key, read_npz
from posefuse.io.ignored_files import Ignored, find_ignored
from posefuse.io.keypoints import deepfly, openpose
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.names import recordings_in, view_names
from posefuse.io.keypoints.openpose import camera_folders
from posefuse.io.keypoints.read import find_format as keypoint_format
from posefuse.io.keypoints.registry import KEYPOINTS

_DEPTH = 4
_CALIBRATION_SUFFIXES = (
    ".toml", ".txt", ".xml", ".xcp", ".yml", ".yaml", ".json", ".mat", ".parquet", ".calib", ".pickle", ".npy", ".npz",
)  # fmt: skip
_OF_FOLDERS = tuple(suffix for suffix in _CALIBRATION_SUFFIXES if suffix not in (".npy", ".npz"))
_MOST_JSON_FILES = 50
_SETTINGS = ("Config.toml", "pyproject.toml")


@dataclass(frozen=True)
class Found:
    """A file or folder in a known format.

    Attributes:
        path: where; several files of a folder by a pattern of their names.
        format: its name.
        why: what it was recognised by.
    """

    path: Path
    format: str
    why: str = ""


@dataclass(frozen=True)
class Recording:
    """What a folder holds.

    Attributes:
        folder: that was searched.
        calibrations: in it, or, where it has none, in the folders above it that are named after a calibration.
        keypoints: in it.
    """

    folder: Path
    calibrations: tuple[Found, ...]
    keypoints: tuple[Found, ...]


def find_recording(folder: Path) -> Recording:
    """Look for calibrations and keypoints in a folder, four levels deep; or at one file of either.

    Raises:
        FileError: if there is no such folder, or the file is neither.
    """
    must_exist(folder, "recording")
    if folder.is_file():
        return _lone_file(folder)
    calibrations = tuple(_find_calibrations(folder, _DEPTH)) or _calibrations_above(folder)
    keypoints = tuple(part for item in _find_keypoints(folder, _DEPTH) for part in _recordings_of(item, calibrations))
    return Recording(folder, calibrations, keypoints)


def _lone_file(file: Path) -> Recording:
    """Keypoints, with the calibrations above them, or a calibration to look at."""
    form = keypoint_format(file)
    if form is not None:
        return Recording(file, _calibrations_above(file), (Found(file, form.name, form.recognized_by),))
    form = calibration_format(file)
    if form is not None:
        return Recording(file, (Found(file, form.name, form.recognized_by),), ())
    raise FileError(
        f"{file} is a file, but no keypoints and no calibration in a known format, or was cut short. Give the "
        "recording's folder."
    )


def choose_calibration(recording: Recording) -> Path:
    """The recording's calibration.

    Raises:
        RecordingError: if there is none, or more than one.
    """
    if not recording.calibrations:
        broken = next(_broken_calibrations(recording.folder), None)
        if broken is not None:
            raise RecordingError(f"{recording.folder} has one calibration, which cannot be read. {broken}")
    return _choose(recording.calibrations, recording, "calibrations", "--calibration")


def _broken_calibrations(folder: Path) -> Iterator[str]:
    """What is wrong with files that are called calibrations and are in no format."""
    for path in sorted(folder.glob("*calib*")):
        if path.is_file() and path.suffix in _CALIBRATION_SUFFIXES and calibration_format(path) is None:
            try:
                read_cameras(path)
            except PosefuseError as error:
                yield str(error)


def choose_keypoints(recording: Recording) -> Path:
    """The recording's keypoints.

    Raises:
        RecordingError: if there are none, or more than one.
    """
    return _choose(recording.keypoints, recording, "sets of 2D keypoints", "--keypoints")


def choose_timestamps(folder: Path, keypoints: Path) -> Path | None:
    """The timestamps in a recording's folder or beside its keypoints, or None where there are none.

    Raises:
        RecordingError: if there are several.
    """
    places = dict.fromkeys(path.resolve() for path in (keypoints, keypoints.parent, folder))
    inside = [place for place in places if place.is_relative_to(folder.resolve())]
    found = timestamps.find(inside)
    if len(found) > 1:
        listed = "".join(f"\n  --timestamps {path}" for path in found)
        raise RecordingError(f"{folder} has {len(found)} sets of timestamps. Choose one:{listed}")
    return found[0] if found else None


def _choose(found: tuple[Found, ...], recording: Recording, what: str, flag: str) -> Path:
    if not found:
        raise RecordingError(
            f"No {what} in {recording.folder}{_searched(recording)}. Give one: {flag} PATH. "
            "posefuse formats lists what can be read."
        )
    first, *others = found
    if others:
        listed = "".join(f"\n  {flag} {item.path}  ({item.format})" for item in found)
        raise RecordingError(
            f"{recording.folder} has {len(found)} {what}, and posefuse does not guess. Choose one:{listed}"
        )
    return first.path


def _searched(recording: Recording) -> str:
    return "" if recording.folder.is_file() else f" (searched {_DEPTH} levels deep)"


def _entries(folder: Path) -> list[Path]:
    if (folder / "reconstruction.nc").exists():
        # A result: what it holds of a recording, projected points, was not recorded.
        return []
    try:
        entries = [entry for entry in folder.iterdir() if not entry.name.startswith(".")]
    except OSError:
        return []
    return sorted(entries, key=lambda entry: natural_key(entry.name))


def _find_keypoints(folder: Path, depth: int) -> Iterator[Found]:
    form = _try_format(folder)
    if form is not None:
        yield Found(folder, form.name, form.recognized_by)
        return
    for entry in _entries(folder):
        if entry.is_dir():
            if depth > 0 and not camera_like(entry):
                yield from _find_keypoints(entry, depth - 1)
            continue
        if entry.suffix in (".npy", ".npz") and not _is_keypoint_array(entry):
            continue
        form = _try_format(entry)
        if form is not None:
            yield Found(entry, form.name, form.recognized_by)


def camera_like(folder: Path) -> bool:
    """Whether a folder holds images or videos only, which need no search."""
    media = (".jpg", ".jpeg", ".png", ".mp4", ".avi")
    first = next((entry for entry in folder.iterdir() if entry.is_file()), None)
    return first is not None and first.suffix.lower() in media and not camera_folders(folder)


def _find_calibrations(folder: Path, depth: int, known: frozenset[str] = frozenset()) -> Iterator[Found]:
    """The calibrations in a folder; one that is a file a camera is its folder, and ``known`` below it."""
    entries = _entries(folder)
    whole = calibration_format(folder)
    if whole is not None and whole.name not in known:
        yield Found(folder, whole.name, whole.recognized_by)
        known |= {whole.name}
    # More than a few are the frames of a recording.
    too_many = sum(entry.suffix == ".json" for entry in entries) > _MOST_JSON_FILES
    for entry in entries:
        if entry.is_dir():
            if depth > 0 and not openpose.matches(entry) and not camera_like(entry):
                yield from _find_calibrations(entry, depth - 1, known)
        elif entry.suffix in _CALIBRATION_SUFFIXES and entry.name not in _SETTINGS:
            form = None if too_many and entry.suffix == ".json" else calibration_format(entry)
            if form is not None and form.name not in known:
                yield Found(entry, form.name, form.recognized_by)


def _calibrations_above(folder: Path) -> tuple[Found, ...]:
    """Pose2Sim keeps one calibration for all trials: beside them, or beside the participants."""
    for level in list(folder.resolve().parents)[:2]:
        found = [
            item
            for entry in _entries(level)
            if entry.is_dir() and entry.name.lower().startswith("calib")
            for item in _find_calibrations(entry, 0)
        ]
        if found:
            return tuple(found)
    return ()


def _try_format(path: Path) -> KeypointFormat | None:
    try:
        return keypoint_format(path)
    except (PosefuseError, OSError):
        return None


def _recordings_of(found: Found, calibrations: tuple[Found, ...]) -> list[Found]:
    """The recordings of a folder of a file a camera: usually one; several are told by the files' names."""
    form = KEYPOINTS.find(found.format)
    if form is None:
        return [found]
    if form.trials_in is not None and len(trials := form.trials_in(found.path)) > 1:
        return [replace(found, path=trial) for trial in trials]
    files = form.camera_files(found.path) if form.camera_files is not None and found.path.is_dir() else []
    if len({file.parent for file in files}) != 1:
        return [found]
    try:
        view_names(files)
    except FileError:
        patterns = recordings_in(files, _camera_names(calibrations))
        return [replace(found, path=files[0].parent / pattern) for pattern in patterns] or [found]
    return [found]


def _camera_names(calibrations: tuple[Found, ...]) -> set[str]:
    """Of the calibrations that can be read."""
    names: set[str] = set()
    for item in calibrations:
        with contextlib.suppress(PosefuseError):
            names.update(read_cameras(item.path).names)
    return names


def ignored_in(recording: Recording) -> tuple[Ignored, ...]:
    """What is in the folder and is not read, and why."""
    if recording.folder.is_file():
        return ()
    used = {path for item in recording.calibrations for path in _calibration_files(item.path)}
    used |= {path for item in recording.keypoints for path in _keypoint_files(item)}
    for keypoints in recording.keypoints:
        used.update(timestamps.find([keypoints.path, keypoints.path.parent, recording.folder]))
    return find_ignored(recording.folder, used, _DEPTH)


def _calibration_files(path: Path) -> list[Path]:
    """The files of a calibration."""
    if not path.is_dir():
        return files_at(path)
    return [entry for entry in path.rglob("*") if entry.suffix in _OF_FOLDERS]


def _keypoint_files(item: Found) -> list[Path]:
    """The files of keypoints that are read, or whole folders of them."""
    form = KEYPOINTS.find(item.format)
    files_of = None if form is None else form.input_files
    if not item.path.is_dir():
        beside = files_of(item.path) if files_of is not None and item.path.is_file() else []
        return [*files_at(item.path), *beside]
    return files_of(item.path) if files_of is not None else [item.path, *_calibration_files(item.path)]


def _is_keypoint_array(path: Path) -> bool:
    try:
        if path.suffix == ".npz":
            names = read_npz(path, ())
            return "keypoints" in names or len(names) == 1 or deepfly.matches(path)
        shape = np.load(path, mmap_mode="r", allow_pickle=False).shape
    except Exception:  # a broken header raises whatever its bytes lead to
        return False
    return len(shape) == 4 and shape[-1] in (2, 3)
