"""Anipose's and FreeMoCap's calibration TOML: tables cam_0, cam_1, ..., unit of the board, unknown up axis.

Rotation (Rodrigues vector) and translation are world to camera, with OpenCV's camera axes; there are five distortion
coefficients, or four with ``fisheye = true``. Files written by posefuse also have ``unit``, ``up_axis``, ``notes``,
``left_out``, ``correlation`` and ``[metadata.covariance]`` under ``[metadata]``, which other programs ignore. Tables
are ordered by number, so that cam_2 precedes cam_10.
"""

from pathlib import Path
from typing import Any

from posefuse.errors import FileError, choices, suggestion
from posefuse.io.calibration.covariances import read_correlation, read_covariances, text_with_covariances
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.tables import (
    METERS_PER_UNIT,
    camera_from_table,
    camera_tables,
    guess_unit,
    metadata_texts,
    table_from_camera,
    texts,
)
from posefuse.io.files import read_toml, replacing
from posefuse.model.cameras import UP_AXES, CameraRig, LensModel, UpAxis
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    return path.suffix == ".toml" and bool(camera_tables(read_toml(path)))


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of their numbers.

    Args:
        path: the file.
        unit: unit of its lengths; by default ``unit`` of ``[metadata]``, otherwise guessed from the distances between
            the cameras (see :func:`posefuse.io.calibration.tables.guess_unit`).

    Raises:
        FileError: if the file does not conform to its format.
        CameraError: if a camera's parameters are invalid.
    """
    data = read_toml(path)
    tables = camera_tables(data)
    if not tables:
        raise FileError(f"{path} has no cameras: expected tables [cam_0], [cam_1], ..., got {choices(data)}.")
    metadata = data.get("metadata", {})
    stated_unit = metadata.get("unit")
    if stated_unit is not None and stated_unit not in METERS_PER_UNIT:
        raise FileError(f"{path}: metadata.unit is {stated_unit!r}. {suggestion(str(stated_unit), METERS_PER_UNIT)}")
    notes: tuple[str, ...] = ()
    chosen = unit or stated_unit
    if chosen is None:
        chosen = guess_unit((table.get("rotation"), table.get("translation")) for table in tables.values())
        notes = (f"{path.name} does not specify its unit of length; assumed {chosen}. Set it with `length_unit`.",)
    cameras = tuple(camera_from_table(path, key, table, METERS_PER_UNIT[chosen]) for key, table in tables.items())
    notes = (*texts(path, metadata, "notes"), *notes)
    left_out = texts(path, metadata, "left_out")
    covariances = read_covariances(path, metadata)
    return CameraRig(
        cameras,
        _up_axis(path, metadata),
        path.name,
        METERS_PER_UNIT[chosen],
        notes,
        left_out,
        covariances=covariances,
        correlation=read_correlation(path, metadata, covariances),
    )


def _up_axis(path: Path, metadata: dict[str, Any]) -> UpAxis | None:
    up = metadata.get("up_axis")
    if up is None and (metadata.get("groundplane_calibration") or metadata.get("groundplane_applied")):
        return "z"
    if up is not None and up not in UP_AXES:
        raise FileError(f"{path}: metadata.up_axis is {up!r}. {suggestion(str(up), UP_AXES)}")
    return up


def write(rig: CameraRig, path: Path) -> None:
    """Write a rig, in meters.

    Raises:
        FileError: if the format does not support a lens model.
    """
    data: dict[str, Any] = {}
    for i, camera in enumerate(rig.cameras):
        data[f"cam_{i}"] = table_from_camera(camera, camera.distortion or [0.0] * 5)
        if camera.lens is LensModel.FISHEYE:
            data[f"cam_{i}"]["fisheye"] = True
    data["metadata"] = {"unit": "m"} | ({"up_axis": rig.up_axis} if rig.up_axis and rig.inferred_up is None else {})
    data["metadata"] |= metadata_texts(rig)
    with replacing(path) as temporary:
        temporary.write_text(text_with_covariances(data, rig), "utf-8")


FORMAT = CalibrationFormat(
    name="anipose",
    files="*.toml, tables cam_0, cam_1, ... (also FreeMoCap)",
    conventions=("the board's unit, often mm: `length_unit`; up axis unknown: `up`; world to camera; Rodrigues vector"),
    recognized_by="TOML with tables cam_0, cam_1, ... of name, matrix, rotation",
    matches=matches,
    read=read,
    write=write,
    endings=(".toml",),
)
