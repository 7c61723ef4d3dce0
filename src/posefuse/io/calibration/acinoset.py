"""AcinoSet's scene JSON: fisheye lenses, meters, world to camera; cameras are numbered ``cam1``, ``cam2``, ..."""

from pathlib import Path

from posefuse.io.calibration.camera_records import CameraRecord, build_rig, dict_list, json_matches, read_json
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    data = json_matches(path)
    cameras = dict_list(data, "cameras")
    return bool(cameras) and "camera_resolution" in data and all({"k", "d", "r", "t"} <= set(c) for c in cameras)


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of the file.

    Raises:
        FileError: if the file does not conform to its format.
        CameraError: if a camera's parameters are invalid.
    """
    data = read_json(path)
    records = [
        CameraRecord(
            f"cam{i}", c.get("k"), c.get("r"), c.get("t"), c.get("d", ()), data.get("camera_resolution"), fisheye=True
        )
        for i, c in enumerate(dict_list(data, "cameras"), 1)
    ]
    return build_rig(path, records, unit, "m")


FORMAT = CalibrationFormat(
    name="acinoset",
    files="*.json with camera_resolution",
    conventions="meters; fisheye; world to camera; up axis unknown: `up`",
    recognized_by="JSON with camera_resolution",
    matches=matches,
    read=read,
)
