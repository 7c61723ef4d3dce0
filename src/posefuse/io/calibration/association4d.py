"""4D Association's ``calibration.json``: one object per camera with ``K``, ``RT`` (12 numbers, [R | t]), ``imgSize``.

Meters, world to camera; without ``distCoeff``, images are assumed to be undistorted.
"""

from pathlib import Path

from posefuse.io.calibration.camera_records import CameraRecord, as_numbers, build_rig, json_matches, read_json
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import natural_key
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    data = json_matches(path)
    return isinstance(data, dict) and bool(data) and all(
        isinstance(camera, dict) and {"K", "RT"} <= set(camera) for camera in data.values()
    )  # fmt: skip


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of their numbers.

    Raises:
        FileError: if the file does not conform to its format.
        CameraError: if a camera's parameters are invalid.
    """
    data = read_json(path)
    records = []
    for name in sorted(data, key=natural_key):
        camera = data[name]
        pose = as_numbers(camera.get("RT"), f"{path}, camera {name!r}: RT")
        # A wrong count is passed on, so that the error message of build_rig states it.
        rows = pose.reshape(3, 4) if pose.size == 12 else pose[None, :]
        records.append(
            CameraRecord(
                name, camera.get("K"), rows[:, :3], rows[:, 3:], camera.get("distCoeff", ()), camera.get("imgSize")
            )
        )
    return build_rig(path, records, unit, "m")


FORMAT = CalibrationFormat(
    name="association4d",
    files="calibration.json of 4D Association",
    conventions="meters; world to camera; up axis unknown: `up`",
    recognized_by="JSON of cameras with K, RT, imgSize",
    matches=matches,
    read=read,
)
