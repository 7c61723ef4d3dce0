"""Pose2Sim's calibration TOML: a table a camera, metres, z up, four distortion coefficients.

Told from Anipose's by its four coefficients and by writing ``fisheye = false`` into every table. Coefficients are
read as written; files that Pose2Sim converted from Qualisys hold them divided by 64, its converter's slip.
"""

from pathlib import Path

from posefuse.io.calibration.tables import METRES, camera_from_table, camera_tables
from posefuse.io.files import read_toml
from posefuse.model.cameras import CameraRig
from posefuse.model.options import LengthUnit


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
    tables = camera_tables(read_toml(path))
    cameras = tuple(camera_from_table(path, key, table, scale) for key, table in tables.items())
    return CameraRig(cameras, up_axis="z", source=path.name, metres_per_unit=scale)
