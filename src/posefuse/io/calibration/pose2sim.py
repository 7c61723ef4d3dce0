"""Pose2Sim's calibration TOML: one table per camera, meters, z up, four distortion coefficients.

It differs from Anipose's format by four coefficients and ``fisheye = false`` in every table. Coefficients are read as
written; files that Pose2Sim converted from Qualisys have them divided by 64, by an error of the converter. Files
written by posefuse also have ``notes`` and ``left_out`` under ``[metadata]``, which Pose2Sim ignores.
"""

from pathlib import Path
from typing import Any

import tomli_w

from posefuse.errors import FileError
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.tables import (
    METERS_PER_UNIT,
    camera_from_table,
    camera_tables,
    metadata_texts,
    table_from_camera,
    texts,
)
from posefuse.io.files import read_toml, replacing
from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    if path.suffix != ".toml":
        return False
    tables = camera_tables(read_toml(path)).values()
    return bool(tables) and all(
        table.get("fisheye") is False and len(table.get("distortions", ())) == 4 for table in tables
    )


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of their numbers.

    Raises:
        FileError: if the file does not conform to its format.
        CameraError: if a camera's parameters are invalid.
    """
    scale = METERS_PER_UNIT[unit or "m"]
    data = read_toml(path)
    tables = camera_tables(data)
    cameras = tuple(camera_from_table(path, key, table, scale) for key, table in tables.items())
    metadata = data.get("metadata", {})
    notes, left_out = (texts(path, metadata, key) for key in ("notes", "left_out"))
    return CameraRig(cameras, "z", path.name, scale, notes, left_out)


def write(rig: CameraRig, path: Path) -> None:
    """Write a rig, in meters.

    Raises:
        FileError: if up is not z, or a lens has coefficients other than k1 k2 p1 p2.
    """
    if rig.up_axis != "z":
        raise FileError(f"Pose2Sim's format requires the up axis z, but it is {rig.up_axis or 'unknown'}")
    data: dict[str, Any] = {}
    for i, camera in enumerate(rig.cameras):
        # Tables are read in the order of the numbers in their names, so the names keep the order of the cameras.
        data[f"cam_{i:02d}"] = {**table_from_camera(camera, _four_coefficients(camera)), "fisheye": False}
    data["metadata"] = {"adjusted": False, "error": 0.0} | metadata_texts(rig)
    with replacing(path) as temporary:
        temporary.write_text(tomli_w.dumps(data), "utf-8")


def _four_coefficients(camera: Camera) -> list[float]:
    """Return the coefficients k1 k2 p1 p2.

    Raises:
        FileError: if the lens has others.
    """
    coefficients = [*camera.distortion, *[0.0] * (4 - len(camera.distortion))]
    if camera.lens not in (LensModel.PINHOLE, LensModel.BROWN) or any(coefficients[4:]):
        raise FileError(
            f"the Pose2Sim format has only k1 k2 p1 p2, but camera {camera.name!r} has other distortion coefficients"
        )
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
