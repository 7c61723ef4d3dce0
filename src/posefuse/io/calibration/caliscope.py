"""Caliscope's ``config.toml`` (old: tables ``cam_0``, rotation as matrix) and ``camera_array.toml`` (``[cameras.0]``).

Meters, world to camera; the rotation is a Rodrigues vector or a matrix. Points refer to the image as recorded, before
the display rotation ``rotation_count``. Cameras marked as ignored or without a pose are left out with a note.
"""

from pathlib import Path
from typing import Any

from posefuse.errors import FileError, choices
from posefuse.io.calibration.camera_records import CameraRecord, build_rig
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import natural_key, read_toml
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    return path.suffix == ".toml" and bool(_tables(read_toml(path)))


def _tables(data: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the tables of cameras by number, in order."""
    inside = data.get("cameras")
    if isinstance(inside, dict):
        records = {key: table for key, table in inside.items() if isinstance(table, dict) and "size" in table}
    else:
        records = {
            key.removeprefix("cam_"): table
            for key, table in data.items()
            if key.startswith("cam_") and isinstance(table, dict) and "rotation_count" in table
        }
    return {key: records[key] for key in sorted(records, key=natural_key)}


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras that have a pose, in the order of their numbers, as ``cam_<number>``.

    Raises:
        FileError: if the file does not conform to its format, or no camera has a pose.
        CameraError: if a camera's parameters are invalid.
    """
    tables = _tables(read_toml(path))
    used = {
        number: table
        for number, table in tables.items()
        if not table.get("ignore", False) and {"matrix", "rotation", "translation"} <= set(table)
    }
    if not used:
        raise FileError(
            f"{path}: none of the cameras {choices(tables)} has matrix, rotation and translation; calibrate first."
        )
    left = [f"cam_{number}" for number in tables if number not in used]
    notes = (f"{path.name}: left out (ignored or without a pose): {choices(left)}.",) if left else ()
    records = [
        CameraRecord(
            f"cam_{number}", table["matrix"], table["rotation"], table["translation"], table.get("distortions", ()),
            table.get("size"), fisheye=table.get("fisheye") is True,
        )
        for number, table in used.items()
    ]  # fmt: skip
    return build_rig(path, records, unit, "m", notes=notes)


FORMAT = CalibrationFormat(
    name="caliscope",
    files="config.toml, camera_array.toml",
    conventions="meters; world to camera; Rodrigues vector or matrix; up axis unknown: `up`",
    recognized_by="tables of cameras with port or cam_id, in one TOML file",
    matches=matches,
    read=read,
)
