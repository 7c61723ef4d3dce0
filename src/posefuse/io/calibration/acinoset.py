"""AcinoSet's scene JSON: fisheye lenses, metres, world to camera; cameras by their place, ``cam1``, ``cam2``, ..."""

from pathlib import Path

from posefuse.io.calibration.building import Found, build_rig, dict_list, json_matches, read_json
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Whether the file is one."""
    data = json_matches(path)
    cameras = dict_list(data, "cameras")
    return bool(cameras) and "camera_resolution" in data and all({"k", "d", "r", "t"} <= set(c) for c in cameras)


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras, in the file's order.

    Raises:
        FileError: if the file is not what its format says.
        CameraError: if a camera's numbers cannot be.
    """
    data = read_json(path)
    found = [
        Found(
            f"cam{i}", c.get("k"), c.get("r"), c.get("t"), c.get("d", ()), data.get("camera_resolution"), fisheye=True
        )
        for i, c in enumerate(dict_list(data, "cameras"), 1)
    ]
    return build_rig(path, found, unit, "m")


FORMAT = CalibrationFormat(
    name="acinoset",
    files="*.json with camera_resolution",
    conventions="meters; fisheye; world to camera; up axis unknown: --up",
    recognized_by="JSON with camera_resolution",
    matches=matches,
    read=read,
)
