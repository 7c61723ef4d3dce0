"""CMU Panoptic's ``calibration_*.json``: cm, y pointing down, world to camera, five coefficients."""

from pathlib import Path

from posefuse.io.calibration.camera_records import CameraRecord, build_rig, dict_list, json_matches, read_json
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    cameras = dict_list(json_matches(path), "cameras")
    return bool(cameras) and all({"K", "R", "t", "distCoef"} <= set(camera) for camera in cameras)


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of the file.

    Raises:
        FileError: if the file does not conform to its format.
        CameraError: if a camera's parameters are invalid.
    """
    records = [
        CameraRecord(
            str(c.get("name", i)), c.get("K"), c.get("R"), c.get("t"), c.get("distCoef", ()), c.get("resolution")
        )
        for i, c in enumerate(dict_list(read_json(path), "cameras"))
    ]
    return build_rig(path, records, unit, "cm", "-y")


FORMAT = CalibrationFormat(
    name="panoptic",
    files="calibration_*.json",
    conventions="cm, -y up; world to camera",
    recognized_by="JSON of cameras with K, R, t, distCoef",
    matches=matches,
    read=read,
)
