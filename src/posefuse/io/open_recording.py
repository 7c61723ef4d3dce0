"""Open a recording: its calibration, 2D keypoints and timestamps."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from posefuse.arguments import checked
from posefuse.errors import DetectionsError
from posefuse.io.calibration.read import read_cameras
from posefuse.io.files import files_at, must_exist
from posefuse.io.keypoints.read import detected_keypoints, read_keypoints
from posefuse.io.keypoints.request import Request
from posefuse.io.recording import choose_timestamps, find_inputs
from posefuse.io.timestamps import read_timestamps
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.preprocess.uncalibrated import uncalibrated_camera
from posefuse.progress import Progress, Silent


@checked
@dataclass(frozen=True)
class RecordingInputs:
    """Paths of a recording's inputs.

    Attributes:
        calibration: calibration file; None to use the one in the recording's folder.
        keypoints: file or folder of 2D keypoints; None to use those in the recording's folder.
        timestamps: table or folder of frame times; None to use those in the recording's folder, if any.
        edits: TOML file of edits to apply to the result, or None.
        board: description of the board, or its file, to calibrate the cameras of a recording that has images of a
            board instead of a calibration; None to use the description beside the images, if any.
    """

    calibration: Path | None = None
    keypoints: Path | None = None
    timestamps: Path | None = None
    edits: Path | None = None
    board: str | None = None


@dataclass(frozen=True)
class OpenedRecording:
    """The contents of a recording.

    Attributes:
        rig: calibrated cameras; a single camera whose keypoints are placed in its image plane needs no calibration.
        detections: 2D keypoints.
        digests: file name to the SHA-256 of its content; for a folder, of the names and contents of its files.
    """

    rig: CameraRig
    detections: Detections
    digests: dict[str, str]


def open_recording(
    folder: Path,
    inputs: RecordingInputs | None = None,
    options: Options | None = None,
    progress: Progress | None = None,
    *,
    timed: bool = False,
) -> OpenedRecording:
    """Read a recording's calibration, keypoints and timestamps.

    Args:
        folder: the recording's folder.
        inputs: paths of inputs that are not found in the folder or are ambiguous there.
        options: options of the command that reads it (units, up axis, skeleton, frame rate).
        progress: receives the progress of reading.
        timed: whether to refuse keypoints without frame times, unless the options say that frames are unrelated.

    Raises:
        PosefuseError: if an input is missing, ambiguous or broken, or ``timed`` and no frame rate is known.
    """
    inputs, options = inputs or RecordingInputs(), options or Options()
    calibration, keypoints = calibration_and_keypoints(folder, inputs, options)
    timestamps = inputs.timestamps
    nearby = None if timestamps is not None else timestamps_in(folder, keypoints, options)
    # Hashed before reading: if a file changes meanwhile, the digest does not match the new content.
    digests = _digests(calibration, keypoints, timestamps, nearby)
    known = None
    if calibration is not None:
        known = read_cameras(calibration, length_unit=options.length_unit, up=options.up)
    detections = read_keypoints(keypoints, _request(options, progress or Silent(), timestamps, nearby))
    rig = known or uncalibrated_camera(detections, options.image_size)
    if timed and options.people != "stills":
        require_times(detections)
    return OpenedRecording(rig, detections, digests)


def input_digests(folder: Path, inputs: RecordingInputs, options: Options) -> dict[str, str]:
    """Return the digests of a recording's inputs, as :attr:`OpenedRecording.digests`.

    Raises:
        PosefuseError: if an input is missing or ambiguous.
    """
    calibration, keypoints = calibration_and_keypoints(folder, inputs, options)
    nearby = None if inputs.timestamps is not None else timestamps_in(folder, keypoints, options)
    return _digests(calibration, keypoints, inputs.timestamps, nearby)


def _digests(*files: Path | None) -> dict[str, str]:
    return {file.name: digest_path(file) for file in files if file is not None and (file.exists() or files_at(file))}


def calibration_and_keypoints(
    folder: Path, inputs: RecordingInputs, options: Options | None = None
) -> tuple[Path | None, Path]:
    """Return the paths of a recording's calibration, None for one camera that needs none, and of its keypoints.

    Raises:
        RecordingError: if an input is missing or ambiguous; one message names all problems.
    """
    found = find_inputs(folder, inputs.calibration, inputs.keypoints, options)
    calibration = None if found.calibration is None else must_exist(found.calibration, "calibration")
    return calibration, detected_keypoints(found.keypoints)


def keypoint_request(
    folder: Path, keypoints: Path, options: Options, progress: Progress, timestamps: Path | None = None
) -> Request:
    """Return the settings for reading a recording's keypoints.

    Args:
        folder: the recording's folder.
        keypoints: the keypoints in it.
        options: options as requested.
        progress: receives the progress of reading.
        timestamps: table or folder of frame times; None to use those beside the keypoints where neither the keypoints
            nor the options give times.

    Raises:
        PosefuseError: if there are several tables of timestamps, or they are broken.
    """
    nearby = None if timestamps is not None else timestamps_in(folder, keypoints, options)
    return _request(options, progress, timestamps, nearby)


def _request(options: Options, progress: Progress, timestamps: Path | None, nearby: Path | None) -> Request:
    if timestamps is not None:
        return Request.of(options, progress, read_timestamps(timestamps))
    return Request.of(options, progress, nearby=None if nearby is None else read_timestamps(nearby))


def timestamps_in(folder: Path, keypoints: Path, options: Options) -> Path | None:
    """Return a recording's timestamps; None if it has none, or if the options give frame rates.

    Raises:
        RecordingError: if there are several.
    """
    rates_given = options.rate_hz is not None or bool(options.view_rates_hz)
    return None if rates_given else choose_timestamps(folder, keypoints)


def has_times(detections: Detections) -> bool:
    """Return whether the frames of a recording have times."""
    return detections.rate_hz is not None or bool((detections.time_s == detections.time_s).any())


def require_times(detections: Detections) -> None:
    """Refuse keypoints without frame times, before any work is done.

    Raises:
        DetectionsError: if the frame rate is unknown.
    """
    if not has_times(detections):
        raise DetectionsError(
            "The keypoint files do not specify their frame rate, which the results need. Add `rate_hz=60` (or the "
            "frame rate of your videos), or `people='stills'` if the frames are unrelated."
        )


def digest_path(path: Path) -> str:
    """Return the SHA-256 of a file, or of the names and contents of a folder's files."""
    total = hashlib.sha256()
    files = files_at(path) if not path.is_dir() else sorted(entry for entry in path.rglob("*") if entry.is_file())
    for file in files:
        if len(files) > 1 or path.is_dir():
            total.update(file.relative_to(path if path.is_dir() else path.parent).as_posix().encode())
        with file.open("rb") as stream:
            while block := stream.read(1 << 20):
                total.update(block)
    return total.hexdigest()
