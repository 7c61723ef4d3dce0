"""Reading a recording as every command does."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from posefuse.errors import DetectionsError
from posefuse.io.calibration.read import read_cameras
from posefuse.io.files import files_at
from posefuse.io.keypoints.read import read_keypoints
from posefuse.io.keypoints.request import Request
from posefuse.io.recording import choose_timestamps, find_inputs
from posefuse.io.timestamps import read_timestamps
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.progress import Progress


@dataclass(frozen=True)
class Inputs:
    """What was read.

    Attributes:
        rig: the cameras.
        detections: the 2D keypoints.
        digests: file name to the SHA-256 of its content; of a folder, of its files' names and contents.
    """

    rig: CameraRig
    detections: Detections
    digests: dict[str, str]


def read_inputs(
    folder: Path,
    calibration: Path | None,
    keypoints: Path | None,
    options: Options,
    progress: Progress,
    timestamps: Path | None = None,
) -> Inputs:
    """Read a recording's calibration, keypoints and timestamps, found in its folder unless given.

    Raises:
        PosefuseError: with what is missing, ambiguous or broken.
    """
    found = find_inputs(folder, calibration, keypoints, options)
    calibration, keypoints = found.calibration, found.keypoints
    nearby = None if timestamps is not None else timestamps_of(folder, keypoints, options)
    # Before they are read: what changes meanwhile is then of other digests, and nothing is taken for made of it.
    files = [file for file in (calibration, keypoints, timestamps, nearby) if file is not None]
    digests = {file.name: digest(file) for file in files if file.exists() or files_at(file)}
    rig = read_cameras(calibration, length_unit=options.length_unit, up=options.up)
    return Inputs(rig, read_keypoints(keypoints, _request(options, progress, timestamps, nearby)), digests)


def request_of(
    folder: Path, keypoints: Path, options: Options, progress: Progress, timestamps: Path | None = None
) -> Request:
    """What to tell the reader of a recording's keypoints.

    Args:
        folder: the recording's.
        keypoints: in it.
        options: as given.
        progress: told how far the reading is.
        timestamps: as given; otherwise those beside the keypoints count where nothing else tells times.

    Raises:
        PosefuseError: if there are several, or they are broken.
    """
    nearby = None if timestamps is not None else timestamps_of(folder, keypoints, options)
    return _request(options, progress, timestamps, nearby)


def _request(options: Options, progress: Progress, timestamps: Path | None, nearby: Path | None) -> Request:
    if timestamps is not None:
        return Request.of(options, progress, read_timestamps(timestamps))
    return Request.of(options, progress, nearby=None if nearby is None else read_timestamps(nearby))


def timestamps_of(folder: Path, keypoints: Path, options: Options) -> Path | None:
    """The timestamps in a recording that count: none where the options tell when frames were.

    Raises:
        RecordingError: if there are several.
    """
    told = options.rate_hz is not None or bool(options.view_rates_hz)
    return None if told else choose_timestamps(folder, keypoints)


def must_have_rate(detections: Detections) -> None:
    """Refuse keypoints without times, before any work is done.

    Raises:
        DetectionsError: if the frame rate is unknown.
    """
    if detections.rate_hz is None and not (detections.time_s == detections.time_s).any():
        raise DetectionsError(
            "The keypoint files do not say how many frames a second they have, and the results need it. "
            "Add --rate-hz 60 (or whatever the videos have)."
        )


def digest(path: Path) -> str:
    """SHA-256 of a file, or of the names and contents of a folder's files."""
    total = hashlib.sha256()
    files = files_at(path) if not path.is_dir() else sorted(entry for entry in path.rglob("*") if entry.is_file())
    for file in files:
        if len(files) > 1 or path.is_dir():
            total.update(file.relative_to(path if path.is_dir() else path.parent).as_posix().encode())
        with file.open("rb") as stream:
            while block := stream.read(1 << 20):
                total.update(block)
    return total.hexdigest()
