"""Read any calibration."""

from dataclasses import replace
from pathlib import Path

from posefuse.errors import FileError, choices
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.registry import CALIBRATIONS
from posefuse.io.files import must_exist
from posefuse.model.cameras import CameraRig, UpAxis
from posefuse.model.options.options import LengthUnit


def find_format(path: Path) -> CalibrationFormat | None:
    """The format a calibration file (or folder of a file a camera) is in, or None where it is none."""
    for form in CALIBRATIONS:
        try:
            if form.matches(path):
                return form
        except FileError:
            continue
    return None


def read_cameras(path: str | Path, *, length_unit: LengthUnit | None = None, up: UpAxis | None = None) -> CameraRig:
    """Read a calibration file, whatever its format.

    Args:
        path: the file; of formats with a file a camera, their folder or one of them.
        length_unit: the unit of its lengths, for formats that do not say.
        up: the world's up axis, for formats that do not say; it overrules those that do.

    Returns:
        The rig, in metres.

    Raises:
        FileError: if there is no such file, or no reader knows it.
        CameraError: if a camera's numbers cannot be.
    """
    path = must_exist(Path(path), "calibration file")
    form = find_format(path)
    if form is None and path.is_dir():
        raise FileError(
            f"{path} is a folder without calibrations of a file a camera; give the calibration file itself."
        )
    if form is None:
        # A file that claims to be TOML or XML but is not deserves that message, not "unknown format".
        for candidate in CALIBRATIONS:
            candidate.matches(path)
        known = choices(f"{form.name} ({form.files})" for form in CALIBRATIONS)
        raise FileError(f"{path} is no calibration in a known format. Known: {known}.")
    rig = form.read(path, length_unit)
    return rig if up is None else replace(rig, up_axis=up)
