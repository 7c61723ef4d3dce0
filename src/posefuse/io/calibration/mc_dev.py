"""mc_dev's and BioCV's ``.calib``: one text file per camera with 32 numbers: size, K, 4 x 4 pose, k1 k2 p1 p2 k3.

mm, world to camera. Specify the folder or one file; the files beside it with the same ending are read, too. Cameras are
named by the part of the file name before the first dot (``00.mp4.calib``: 00).
"""

from pathlib import Path

from posefuse.errors import FileError, choices
from posefuse.io.calibration.camera_records import CameraRecord, as_numbers, build_rig, small_text
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import natural_key
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_COUNT = 32


def matches(path: Path) -> bool:
    """Return whether the file is in this format, or the folder contains such files."""
    return bool(_files(path))


def _files(path: Path) -> list[Path]:
    """Return the calibrations of the folder, or those with the file's ending."""
    folder = path if path.is_dir() else path.parent
    if not path.is_dir() and path.suffix != ".calib":
        return []
    records = [entry for entry in folder.iterdir() if entry.suffix == ".calib" and entry.is_file()]
    if not path.is_dir():
        records = [entry for entry in records if _ending(entry) == _ending(path)]
    return sorted(records, key=lambda entry: natural_key(entry.name))


def _ending(path: Path) -> str:
    return path.name.partition(".")[2]


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of their names.

    Raises:
        FileError: if a file does not hold 32 numbers, or the folder has two files of a camera.
        CameraError: if a camera's parameters are invalid.
    """
    files = _files(path)
    endings = sorted({_ending(file) for file in files})
    if len(endings) > 1:
        raise FileError(
            f"{path} has calibrations with several endings: {choices(endings)}. Specify one of the files; the files "
            "with its ending are read."
        )
    return build_rig(path, [_camera(file) for file in files], unit, "mm")


def _camera(file: Path) -> CameraRecord:
    values = as_numbers(small_text(file).split(), f"{file}: the text")
    if values.size != _COUNT:
        raise FileError(
            f"{file}: expected {_COUNT} numbers (size 2, K 9, pose 16, distortion 5), got {values.size}. Is it "
            "truncated?"
        )
    pose = values[11:27].reshape(4, 4)
    return CameraRecord(
        file.name.partition(".")[0], values[2:11], pose[:3, :3], pose[:3, 3], values[27:], tuple(values[:2])
    )


FORMAT = CalibrationFormat(
    name="mc_dev",
    files="*.calib, one per camera, or their folder",
    conventions="mm; world to camera; 32 numbers; up axis unknown: `up`",
    recognized_by="*.calib of 32 numbers",
    matches=matches,
    read=read,
)
