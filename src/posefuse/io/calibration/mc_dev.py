"""mc_dev's and BioCV's ``.calib``: a text a camera, 32 numbers without a word: size, K, 4 x 4 pose, k1 k2 p1 p2 k3.

mm, world to camera. Give the folder, or one file: those beside it with the same ending are read with it. Cameras
are named by what stands before the first dot (``00.mp4.calib``: 00).
"""

from pathlib import Path

from posefuse.errors import FileError, choices
from posefuse.io.calibration.building import Found, as_numbers, build_rig, small_text
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import natural_key
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_COUNT = 32


def matches(path: Path) -> bool:
    """Whether the file is one, or the folder holds some."""
    return bool(_files(path))


def _files(path: Path) -> list[Path]:
    """The calibrations of the folder, or those with the file's ending."""
    folder = path if path.is_dir() else path.parent
    if not path.is_dir() and path.suffix != ".calib":
        return []
    found = [entry for entry in folder.iterdir() if entry.suffix == ".calib" and entry.is_file()]
    if not path.is_dir():
        found = [entry for entry in found if _ending(entry) == _ending(path)]
    return sorted(found, key=lambda entry: natural_key(entry.name))


def _ending(path: Path) -> str:
    return path.name.partition(".")[2]


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras, in the order of their names.

    Raises:
        FileError: if a file does not hold 32 numbers, or the folder has two files of a camera.
        CameraError: if a camera's numbers cannot be.
    """
    files = _files(path)
    endings = sorted({_ending(file) for file in files})
    if len(endings) > 1:
        raise FileError(
            f"{path} holds calibrations with the endings {choices(endings)}: several worlds. Give one of the files; "
            "those of its ending are read."
        )
    return build_rig(path, [_camera(file) for file in files], unit, "mm")


def _camera(file: Path) -> Found:
    values = as_numbers(small_text(file).split(), f"{file}: the text")
    if values.size != _COUNT:
        raise FileError(
            f"{file} should hold {_COUNT} numbers (size 2, K 9, pose 16, distortion 5), got {values.size}. Was it cut "
            "short?"
        )
    pose = values[11:27].reshape(4, 4)
    return Found(file.name.partition(".")[0], values[2:11], pose[:3, :3], pose[:3, 3], values[27:], tuple(values[:2]))


FORMAT = CalibrationFormat(
    name="mc_dev",
    files="*.calib, one per camera, or their folder",
    conventions="mm; world to camera; 32 numbers; up axis unknown: --up",
    recognized_by="*.calib of 32 numbers",
    matches=matches,
    read=read,
)
