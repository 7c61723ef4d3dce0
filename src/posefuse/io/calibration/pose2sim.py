"""Pose2Sim's calibration TOML: a table a camera, metres, z up, four distortion coefficients.

Told from Anipose's by its four coefficients and by writing ``fisheye = false`` into every table. Coefficients are
read as written; files that Pose2Sim converted from Qualisys hold them divided by 64, its converter's slip. Files
written here also say ``notes`` and ``left_out`` under ``[metadata]``, which Pose2Sim ignores.
"""

from pathlib import Path
from typing import Any

import tomli_w

from posefuse.errors import FileError
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.tables import METRES, camera_from_table, camera_tables, table_from_camera, texts, told
from posefuse.io.files import read_toml, replacing
from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Whether the file is one."""
    if path.suffix != ".toml":
        return False
    tables = camera_tables(read_toml(path)).values()
    return bool(tables) and all(
        table.get("fisheye") is False and len(table.get("distortions", ())) == 4 for table in tables
    )


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras, in the order of their numbers.

    Raises:
        FileError: if the file is not what its format says.
        CameraError: if a camera's numbers cannot be.
    """
    scale = METRES[unit or "m"]
    data = read_toml(path)
    tables = camera_tables(data)
    cameras = tuple(camera_from_table(path, key, table, scale) for key, table in tables.items())
    metadata = data.get("metadata", {})
    notes, left_out = (texts(path, metadata, key) for key in ("notes", "left_out"))
    return CameraRig(cameras, "z", path.name, scale, notes, left_out)


def write(rig: CameraRig, path: Path) -> None:
    """Write a rig in metres.

    Raises:
        FileError: if the format cannot hold it: up is not z, or a lens has other coefficients than k1 k2 p1 p2.
    """
    if rig.up_axis != "z":
        raise FileError(f"pose2sim's format has z up, and here up is {rig.up_axis or 'unknown'}")
    data: dict[str, Any] = {}
    for i, camera in enumerate(rig.cameras):
        # Tables are read in the order of their names' numbers, which cameras' own names need not be in.
        data[f"cam_{i:02d}"] = {**table_from_camera(camera, _four(camera)), "fisheye": False}
    data["metadata"] = {"adjusted": False, "error": 0.0} | told(rig)
    with replacing(path) as temporary:
        temporary.write_text(tomli_w.dumps(data), "utf-8")


def _four(camera: Camera) -> list[float]:
    """The coefficients k1 k2 p1 p2.

    Raises:
        FileError: if there are others.
    """
    coefficients = [*camera.distortion, *[0.0] * (4 - len(camera.distortion))]
    if camera.lens not in (LensModel.PINHOLE, LensModel.BROWN) or any(coefficients[4:]):
        raise FileError(f"pose2sim's format holds k1 k2 p1 p2, and the lens of camera {camera.name!r} has others")
    return coefficients[:4]


FORMAT = CalibrationFormat(
    name="pose2sim",
    files="*.toml, one table per camera",
    conventions="meters, z up; world to camera; Rodrigues vector; distortion as written",
    recognized_by="TOML with one table per camera, named after it",
    matches=matches,
    read=read,
    write=write,
    file_endings=(".toml",),
)
