"""EasyMocap's ``intri.yml`` and ``extri.yml``: OpenCV's YAML with the camera's name at the end of each key.

``K_<name>``, ``dist_<name>`` (or ``D_<name>``), ``Rot_<name>`` (3 x 3) or ``R_<name>`` (Rodrigues vector),
``T_<name>``, and in newer files ``H_<name>`` and ``W_<name>``; meters, world to camera. Specify either file or their
folder.
"""

from pathlib import Path
from typing import Any

from posefuse.errors import FileError, choices
from posefuse.io.calibration.camera_records import CameraRecord, build_rig
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.opencv_storage import YAML_SUFFIXES, read_storage
from posefuse.io.files import natural_key
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_STEMS = ("intri", "extri")


def matches(path: Path) -> bool:
    """Return whether the file is one of the two, or the folder contains both."""
    return len(_files(path)) == 2


def _files(path: Path) -> list[Path]:
    folder = path if path.is_dir() else path.parent
    if not path.is_dir() and (path.stem not in _STEMS or path.suffix not in YAML_SUFFIXES):
        return []
    pairs = ([folder / f"{stem}{suffix}" for stem in _STEMS] for suffix in YAML_SUFFIXES)
    return next((pair for pair in pairs if all(file.is_file() for file in pair)), [])


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras of both files, in the order of their names.

    Raises:
        FileError: if a file does not conform to its format.
        CameraError: if a camera's parameters are invalid.
    """
    entries: dict[str, Any] = {}
    for file in _files(path):
        entries |= read_storage(file)
    lenses = {key.removeprefix("K_") for key in entries if key.startswith("K_")}
    places = {key.removeprefix("T_") for key in entries if key.startswith("T_")}
    both = sorted(lenses & places, key=natural_key)
    if not both:
        raise FileError(
            f"{path}: no camera is in both files; intri.yml has {choices(sorted(lenses))}, extri.yml "
            f"{choices(sorted(places))}."
        )
    notes = tuple(f"{path.name}: camera {name} is in one of the two files only." for name in sorted(lenses ^ places))
    return build_rig(path, [_camera(path, name, entries) for name in both], unit, "m", notes=notes)


def _camera(path: Path, name: str, entries: dict[str, Any]) -> CameraRecord:
    rotation = next((entries[key] for key in (f"Rot_{name}", f"R_{name}") if key in entries), None)
    if rotation is None:
        raise FileError(f"{path}: camera {name!r} has no rotation: expected Rot_{name} or R_{name}.")
    distortion = next((entries[key] for key in (f"dist_{name}", f"D_{name}") if key in entries), ())
    sides = [entries[key] for key in (f"W_{name}", f"H_{name}") if key in entries]
    size = sides if len(sides) == 2 else None
    return CameraRecord(name, entries[f"K_{name}"], rotation, entries[f"T_{name}"], distortion, size)


FORMAT = CalibrationFormat(
    name="easymocap",
    files="intri.yml and extri.yml, or their folder",
    conventions="meters; world to camera; up axis unknown: `up`",
    recognized_by="intri.yml beside extri.yml",
    matches=matches,
    read=read,
)
