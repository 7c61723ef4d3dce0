"""Caliscope's ``config.toml`` (old: tables ``cam_0``, rotation as matrix) and ``camera_array.toml`` (``[cameras.0]``).

Metres, world to camera; rotation a Rodrigues vector or a matrix; points lie in the image as recorded, before
``rotation_count`` turns it for the screen. Cameras that are to be ignored, or have no place, are left out with a note.
"""

from pathlib import Path
from typing import Any

from posefuse.errors import FileError, choices
from posefuse.io.calibration.building import Found, build_rig
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import natural_key, read_toml
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Whether the file is one."""
    return path.suffix == ".toml" and bool(_tables(read_toml(path)))


def _tables(data: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The tables of cameras by number, in order."""
    inside = data.get("cameras")
    if isinstance(inside, dict):
        found = {key: table for key, table in inside.items() if isinstance(table, dict) and "size" in table}
    else:
        found = {
            key.removeprefix("cam_"): table
            for key, table in data.items()
            if key.startswith("cam_") and isinstance(table, dict) and "rotation_count" in table
        }
    return {key: found[key] for key in sorted(found, key=natural_key)}


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras that have a place, in the order of their numbers, as ``cam_<number>``.

    Raises:
        FileError: if the file is not what its format says, or no camera has a place.
        CameraError: if a camera's numbers cannot be.
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
    notes = (f"{path.name}: left out, being ignored or not placed: {choices(left)}.",) if left else ()
    found = [
        Found(
            f"cam_{number}", table["matrix"], table["rotation"], table["translation"], table.get("distortions", ()),
            table.get("size"), fisheye=table.get("fisheye") is True,
        )
        for number, table in used.items()
    ]  # fmt: skip
    return build_rig(path, found, unit, "m", notes=notes)


FORMAT = CalibrationFormat(
    name="caliscope",
    files="config.toml, camera_array.toml",
    conventions="meters; world to camera; Rodrigues vector or matrix; up axis unknown: --up",
    recognized_by="tables of cameras with port or cam_id, in one TOML file",
    matches=matches,
    read=read,
)
