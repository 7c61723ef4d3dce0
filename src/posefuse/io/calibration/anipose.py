"""Anipose's and FreeMoCap's calibration TOML: tables cam_0, cam_1, ..., the unit of the board, an unknown up axis.

Rotation (Rodrigues vector) and translation are world to camera, the camera OpenCV's; five distortion coefficients, or
four with ``fisheye = true``. Files written here also say ``unit``, ``up_axis``, ``notes`` and ``left_out`` under
``[metadata]``, which other programs ignore. Tables are ordered by number: sorting them as text puts cam_10
before cam_2.
"""

from pathlib import Path
from typing import Any

import tomli_w

from posefuse.errors import FileError, choices, suggestion
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.tables import (
    METRES,
    camera_from_table,
    camera_tables,
    guessed_unit,
    table_from_camera,
    texts,
    told,
)
from posefuse.io.files import read_toml, replacing
from posefuse.model.cameras import UP_AXES, CameraRig, LensModel, UpAxis
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Whether the file is one."""
    return path.suffix == ".toml" and bool(camera_tables(read_toml(path)))


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras, in the order of their numbers.

    Args:
        path: the file.
        unit: of its lengths; by default what ``[metadata]`` says, else mm, or m where the cameras would stand closer
            together than cameras can.

    Raises:
        FileError: if the file is not what its format says.
        CameraError: if a camera's numbers cannot be.
    """
    data = read_toml(path)
    tables = camera_tables(data)
    if not tables:
        raise FileError(f"{path} describes no camera: expected tables [cam_0], [cam_1], ..., got {choices(data)}.")
    metadata = data.get("metadata", {})
    said = metadata.get("unit")
    if said is not None and said not in METRES:
        raise FileError(f"{path}: metadata.unit is {said!r}. {suggestion(str(said), METRES)}")
    notes: tuple[str, ...] = ()
    chosen = unit or said
    if chosen is None:
        chosen = guessed_unit((table.get("rotation"), table.get("translation")) for table in tables.values())
        notes = (f"{path.name} does not say its unit of length; read as {chosen}. --length-unit says otherwise.",)
    cameras = tuple(camera_from_table(path, key, table, METRES[chosen]) for key, table in tables.items())
    notes = (*texts(path, metadata, "notes"), *notes)
    left_out = texts(path, metadata, "left_out")
    return CameraRig(cameras, _up_axis(path, metadata), path.name, METRES[chosen], notes, left_out)


def _up_axis(path: Path, metadata: dict[str, Any]) -> UpAxis | None:
    up = metadata.get("up_axis")
    if up is None and (metadata.get("groundplane_calibration") or metadata.get("groundplane_applied")):
        return "z"
    if up is not None and up not in UP_AXES:
        raise FileError(f"{path}: metadata.up_axis is {up!r}. {suggestion(str(up), UP_AXES)}")
    return up


def write(rig: CameraRig, path: Path) -> None:
    """Write a rig in metres.

    Raises:
        FileError: if a lens model does not fit the format.
    """
    data: dict[str, Any] = {}
    for i, camera in enumerate(rig.cameras):
        data[f"cam_{i}"] = table_from_camera(camera, camera.distortion or [0.0] * 5)
        if camera.lens is LensModel.FISHEYE:
            data[f"cam_{i}"]["fisheye"] = True
    data["metadata"] = {"unit": "m"} | ({"up_axis": rig.up_axis} if rig.up_axis else {})
    data["metadata"] |= told(rig)
    with replacing(path) as temporary:
        temporary.write_text(tomli_w.dumps(data), "utf-8")


FORMAT = CalibrationFormat(
    name="anipose",
    files="*.toml, tables cam_0, cam_1, ... (also FreeMoCap)",
    conventions=("the board's unit, often mm: --length-unit; up axis unknown: --up; world to camera; Rodrigues vector"),
    recognized_by="TOML with tables cam_0, cam_1, ... of name, matrix, rotation",
    matches=matches,
    read=read,
    write=write,
    endings=(".toml",),
)
