"""Read calibrations of any supported format."""

from pathlib import Path

from posefuse.arguments import checked
from posefuse.errors import FileError, choices
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.registry import CALIBRATIONS
from posefuse.io.files import must_exist
from posefuse.io.videos.reader import VIDEO_ENDINGS
from posefuse.model.cameras import CameraRig, UpAxis
from posefuse.model.options.options import LengthUnit


def find_format(path: Path) -> CalibrationFormat | None:
    """Return the format of a calibration file, or of a folder with one file per camera; None if it has none."""
    for form in CALIBRATIONS:
        try:
            if form.matches(path):
                return form
        except FileError:
            continue
    return None


@checked
def read_cameras(path: str | Path, *, length_unit: LengthUnit | None = None, up: UpAxis | None = None) -> CameraRig:
    """Read a calibration of any supported format.

    Args:
        path: the file; for formats with one file per camera, the folder or one of the files.
        length_unit: unit of length, for formats that do not state it.
        up: up axis of the world, for formats that do not state it; it overrides a stated one.

    Returns:
        The rig, in meters.

    Raises:
        FileError: if there is no such file, or its format is not supported.
        CameraError: if a camera's parameters are invalid.
    """
    path = must_exist(Path(path), "calibration file")
    if path.suffix.lower() in VIDEO_ENDINGS:
        raise FileError(
            f"{path} is a video, not a calibration. Calibrate by videos of a board first, with `posefuse calibrate`, "
            "and specify the calibration that it writes."
        )
    form = find_format(path)
    if form is None and path.is_dir():
        raise FileError(
            f"{path} is a folder without one calibration file per camera. Specify the calibration file itself."
        )
    if form is None:
        # Raise the specific error of an invalid TOML or XML file rather than "unknown format".
        for candidate in CALIBRATIONS:
            candidate.matches(path)
        known = choices(f"{form.name} ({form.files})" for form in CALIBRATIONS)
        raise FileError(f"{path} is not a calibration in a supported format. Supported: {known}.")
    rig = form.read(path, length_unit)
    return rig if up is None else rig.with_up(up)
