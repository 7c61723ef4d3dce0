"""Search of a recording's folder for calibrations and keypoints. Between several, the user chooses."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posefuse.errors import FileError, PosefuseError, RecordingError
from posefuse.io import timestamps
from posefuse.io.board_images import find_board_folder
from posefuse.io.board_specs import EXAMPLE
from posefuse.io.calibration.read import find_format as calibration_format
from posefuse.io.calibration.read import read_cameras
from posefuse.io.files import RUN_FILE, files_at, must_exist, natural_key, read_npz
from posefuse.io.ignored_files import Ignored, find_ignored
from posefuse.io.keypoints import deepfly, openpose
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.names import recordings_in, view_names
from posefuse.io.keypoints.openpose import camera_folders
from posefuse.io.keypoints.read import find_format as keypoint_format
from posefuse.io.keypoints.read import has_times, read_keypoints
from posefuse.io.keypoints.registry import KEYPOINTS
from posefuse.io.keypoints.request import Request
from posefuse.io.videos_only import videos_only
from posefuse.model.options.options import Options

CALIBRATION_FILE = "calibration.toml"
"""Name of the calibration that is made from images of a board."""
_SEARCH_DEPTH = 4
_CALIBRATION_SUFFIXES = (
    ".toml", ".txt", ".xml", ".xcp", ".yml", ".yaml", ".json", ".mat", ".parquet", ".calib", ".pickle", ".npy", ".npz",
)  # fmt: skip
_FOLDER_SUFFIXES = tuple(suffix for suffix in _CALIBRATION_SUFFIXES if suffix not in (".npy", ".npz"))
_MAX_JSON_FILES = 50
LENSES_FILE = "lenses.toml"
"""Name of the file of lenses that a run writes; the poses of its cameras mean nothing."""
_SETTINGS = ("Config.toml", "pyproject.toml", LENSES_FILE)
_MAX_PROBED_BYTES = 50_000_000


@dataclass(frozen=True)
class RecognizedInput:
    """A file or folder in a known format.

    Attributes:
        path: The file or folder. Several files of a folder are given by a pattern of their names.
        format: Name of the format.
        recognized_by: Content by which the format was recognized.
    """

    path: Path
    format: str
    recognized_by: str = ""


@dataclass(frozen=True)
class Recording:
    """Calibrations and keypoints found in a folder.

    Attributes:
        folder: The folder that was searched, or a single file.
        calibrations: Calibrations in the folder. If it has none, those in ``calib*`` folders up to two levels above.
        keypoints: Sets of 2D keypoints in the folder.
    """

    folder: Path
    calibrations: tuple[RecognizedInput, ...]
    keypoints: tuple[RecognizedInput, ...]


def find_recording(folder: Path) -> Recording:
    """Find the calibrations and keypoints in a folder, searched four levels deep, or identify a single file.

    Raises:
        FileError: If the path does not exist, or is a file that is neither.
    """
    must_exist(folder, "recording")
    if folder.is_file():
        return _identify_file(folder)
    calibrations = tuple(_find_calibrations(folder, _SEARCH_DEPTH)) or _calibrations_above(folder)
    keypoints = tuple(
        part for item in _find_keypoints(folder, _SEARCH_DEPTH) for part in _recordings_of(item, calibrations)
    )
    return Recording(folder, calibrations, keypoints)


def _identify_file(file: Path) -> Recording:
    """Return a file of keypoints with the calibrations above it, or a calibration."""
    form = keypoint_format(file)
    if form is not None:
        return Recording(file, _calibrations_above(file), (RecognizedInput(file, form.name, form.recognized_by),))
    form = calibration_format(file)
    if form is not None:
        return Recording(file, (RecognizedInput(file, form.name, form.recognized_by),), ())
    raise FileError(
        f"{file} is neither a calibration nor keypoints in a known format, or is truncated. Specify the folder of the "
        "recording."
    )


@dataclass(frozen=True)
class InputPaths:
    """The calibration, None for a single camera that needs none, and the keypoints of a recording."""

    calibration: Path | None
    keypoints: Path


def find_inputs(
    folder: Path, calibration: Path | None = None, keypoints: Path | None = None, options: Options | None = None
) -> InputPaths:
    """Return the calibration and the keypoints of a recording.

    Keypoints of one view need no calibration if the options place them in its image plane.

    Args:
        folder: Folder of the recording, searched for what is not given.
        calibration: Calibration file.
        keypoints: File or folder of keypoints.
        options: Requested options; the message asks for the frame rate, too, if neither they nor the files state it.

    Raises:
        FileError: If the folder does not exist.
        RecordingError: If an input is missing or ambiguous. One message names all problems and what to pass.
    """
    if calibration is not None and keypoints is not None:
        return InputPaths(calibration, keypoints)
    recording, problems = find_recording(folder), []
    if keypoints is None and not recording.keypoints and (advice := videos_only(folder)) is not None:
        raise RecordingError(advice)
    candidates = [keypoints] if keypoints is not None else [item.path for item in recording.keypoints]
    absent = calibration is None and not recording.calibrations and next(_broken_calibrations(folder), None) is None
    if absent and len(candidates) == 1 and _is_flat(candidates[0], options or Options()):
        return InputPaths(None, candidates[0])
    try:
        calibration = calibration or choose_calibration(recording)
    except RecordingError as error:
        problems.append(str(error))
    try:
        keypoints = keypoints or choose_keypoints(recording)
    except RecordingError as error:
        problems.append(str(error))
    if calibration is not None and keypoints is not None:
        return InputPaths(calibration, keypoints)
    options = options or Options()
    if candidates and options.people != "stills" and _lacks_rate(folder, candidates[0], options):
        problems.append("The keypoint files and the files beside them specify no frame rate. Add `rate_hz`.")
    raise RecordingError("\n".join(problems))


def _is_flat(keypoints: Path, options: Options) -> bool:
    """Return whether keypoints are those of one view, which the options place in its image plane."""
    if not options.needs_no_poses:
        return False
    try:
        return read_keypoints(keypoints, Request.of(options)).n_views == 1
    except PosefuseError:
        return False


def _lacks_rate(folder: Path, keypoints: Path, options: Options) -> bool:
    """Return whether keypoints have no times; False if reading them takes long or fails."""
    if options.rate_hz is not None or options.view_rates_hz:
        return False
    files = [file for file in keypoints.rglob("*") if file.is_file()] if keypoints.is_dir() else files_at(keypoints)
    if sum(file.stat().st_size for file in files) > _MAX_PROBED_BYTES:
        return False
    try:
        if choose_timestamps(folder, keypoints) is not None:
            return False
        return not has_times(read_keypoints(keypoints, Request.of(options)))
    except PosefuseError:
        return False


def choose_calibration(recording: Recording) -> Path:
    """Return the only calibration of a recording.

    Raises:
        RecordingError: If it has none, or more than one.
    """
    if not recording.calibrations:
        broken = next(_broken_calibrations(recording.folder), None)
        if broken is not None:
            raise RecordingError(f"{recording.folder} has one calibration, which cannot be read. {broken}")
        images = find_board_folder(recording.folder)
        if images is not None:
            raise RecordingError(
                f"{recording.folder} has no calibration, but {images} has images. If they show a board, add "
                f"`board='{EXAMPLE}'` with the kind and size of your board, or calibrate with posefuse calibrate "
                f"{images} --board {EXAMPLE} --output {images / CALIBRATION_FILE}."
            )
    return _choose(recording.calibrations, recording, "calibrations", "calibration")


def _broken_calibrations(folder: Path) -> Iterator[str]:
    """Yield the errors of files that are named like calibrations but cannot be read as one."""
    for path in sorted(folder.glob("*calib*")):
        if path.is_file() and path.suffix in _CALIBRATION_SUFFIXES and calibration_format(path) is None:
            try:
                read_cameras(path)
            except PosefuseError as error:
                yield str(error)


def choose_keypoints(recording: Recording) -> Path:
    """Return the only set of keypoints of a recording.

    Raises:
        RecordingError: If it has none, or more than one.
    """
    if not recording.keypoints and (advice := videos_only(recording.folder)) is not None:
        raise RecordingError(advice)
    return _choose(recording.keypoints, recording, "sets of 2D keypoints", "keypoints")


def choose_timestamps(folder: Path, keypoints: Path) -> Path | None:
    """Return the timestamps in a recording's folder or beside its keypoints, or None if there are none.

    Raises:
        RecordingError: If there are several.
    """
    folders = dict.fromkeys(path.resolve() for path in (keypoints, keypoints.parent, folder))
    inside = [each for each in folders if each.is_relative_to(folder.resolve())]
    paths = timestamps.find(inside)
    if len(paths) > 1:
        listed = "".join(f"\n  `timestamps={str(path)!r}`" for path in paths)
        raise RecordingError(f"{folder} has {len(paths)} sets of timestamps. Choose one:{listed}")
    return paths[0] if paths else None


def _choose(found: tuple[RecognizedInput, ...], recording: Recording, what: str, argument: str) -> Path:
    if not found:
        searched = f"No {what} found in {recording.folder} (searched {_SEARCH_DEPTH} levels deep)."
        if recording.folder.is_file():
            searched = f"{recording.folder} is a file without {what}. Give the folder of the recording."
        raise RecordingError(
            f"{searched} Set `{argument}` to its path. posefuse formats lists the formats that are read."
        )
    first, *others = found
    if others:
        listed = "".join(f"\n  `{argument}={str(item.path)!r}`  ({item.format})" for item in found)
        raise RecordingError(f"{recording.folder} has {len(found)} {what}. Choose one:{listed}")
    return first.path


def _entries(folder: Path) -> list[Path]:
    if (folder / "reconstruction.nc").exists():
        # The projected points in a result folder are not a recording.
        return []
    try:
        # Nor is the output of a run, which may lie in the recording.
        entries = [
            entry for entry in folder.iterdir() if not (entry.name.startswith(".") or (entry / RUN_FILE).exists())
        ]
    except OSError:
        return []
    return sorted(entries, key=lambda entry: natural_key(entry.name))


def _find_keypoints(folder: Path, depth: int) -> Iterator[RecognizedInput]:
    form = _try_format(folder)
    if form is not None:
        yield RecognizedInput(folder, form.name, form.recognized_by)
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
            yield RecognizedInput(entry, form.name, form.recognized_by)


def camera_like(folder: Path) -> bool:
    """Return whether a folder holds only images or videos, which need no search."""
    media = (".jpg", ".jpeg", ".png", ".mp4", ".avi", ".mov")
    files = [entry for entry in folder.iterdir() if entry.is_file()]
    return bool(files) and all(file.suffix.lower() in media for file in files) and not camera_folders(folder)


def _find_calibrations(folder: Path, depth: int, skipped: frozenset[str] = frozenset()) -> Iterator[RecognizedInput]:
    """Yield the calibrations in a folder.

    A calibration with one file per camera is found as its folder; below it, the same format is ``skipped``.
    """
    entries = _entries(folder)
    whole = calibration_format(folder)
    if whole is not None and whole.name not in skipped:
        yield RecognizedInput(folder, whole.name, whole.recognized_by)
        skipped |= {whole.name}
    # Many JSON files are the frames of a recording.
    too_many = sum(entry.suffix == ".json" for entry in entries) > _MAX_JSON_FILES
    for entry in entries:
        if entry.is_dir():
            if depth > 0 and not openpose.matches(entry) and not camera_like(entry):
                yield from _find_calibrations(entry, depth - 1, skipped)
        elif entry.suffix in _CALIBRATION_SUFFIXES and entry.name not in _SETTINGS:
            form = None if too_many and entry.suffix == ".json" else calibration_format(entry)
            if form is not None and form.name not in skipped:
                yield RecognizedInput(entry, form.name, form.recognized_by)


def _calibrations_above(folder: Path) -> tuple[RecognizedInput, ...]:
    """Return the calibrations in ``calib*`` folders above: Pose2Sim stores one for all trials or participants."""
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


def _recordings_of(found: RecognizedInput, calibrations: tuple[RecognizedInput, ...]) -> list[RecognizedInput]:
    """Return the recordings of a folder with one file per camera, grouped by file name. There is usually one."""
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


def _camera_names(calibrations: tuple[RecognizedInput, ...]) -> set[str]:
    """Return the names of the cameras in all calibrations that can be read."""
    names: set[str] = set()
    for item in calibrations:
        with contextlib.suppress(PosefuseError):
            names.update(read_cameras(item.path).names)
    return names


def ignored_in(recording: Recording) -> tuple[Ignored, ...]:
    """Return the files of a recording's folder that are not read, grouped by reason."""
    if recording.folder.is_file():
        return ()
    used = {path for item in recording.calibrations for path in _calibration_files(item.path)}
    used |= {path for item in recording.keypoints for path in _keypoint_files(item)}
    for keypoints in recording.keypoints:
        used.update(timestamps.find([keypoints.path, keypoints.path.parent, recording.folder]))
    return find_ignored(recording.folder, used, _SEARCH_DEPTH)


def _calibration_files(path: Path) -> list[Path]:
    """Return the files of a calibration."""
    if not path.is_dir():
        return files_at(path)
    return [entry for entry in path.rglob("*") if entry.suffix in _FOLDER_SUFFIXES]


def _keypoint_files(item: RecognizedInput) -> list[Path]:
    """Return the files, or whole folders, of keypoints that are read."""
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
    except Exception:  # a broken header can raise any exception
        return False
    return len(shape) == 4 and shape[-1] in (2, 3)
