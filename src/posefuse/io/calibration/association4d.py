"""4D Association's ``calibration.json``: an object a camera with ``K``, ``RT`` (12 numbers, [R | t]) and ``imgSize``.

Metres, world to camera; images are taken as undistorted where no ``distCoeff`` is given.
"""

from pathlib import Path

from posefuse.io.calibration.building import Found, as_numbers, build_rig, json_matches, read_json
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import natural_key
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Whether the file is one."""
    data = json_matches(path)
    return isinstance(data, dict) and bool(data) and all(
        isinstance(camera, dict) and {"K", "RT"} <= set(camera) for camera in data.values()
    )  # fmt: skip


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras, in the order of their numbers.

    Raises:
        FileError: if the file is not what its format says.
        CameraError: if a camera's numbers cannot be.
    """
    data = read_json(path)
    found = []
    for name in sorted(data, key=natural_key):
        camera = data[name]
        pose = as_numbers(camera.get("RT"), f"{path}, camera {name!r}: RT")
        # A count that is wrong is left as it is, for the message to tell.
        rows = pose.reshape(3, 4) if pose.size == 12 else pose[None, :]
        found.append(
            Found(name, camera.get("K"), rows[:, :3], rows[:, 3:], camera.get("distCoeff", ()), camera.get("imgSize"))
        )
    return build_rig(path, found, unit, "m")


FORMAT = CalibrationFormat(
    name="association4d",
    files="calibration.json of 4D Association",
    conventions="meters; world to camera; up axis unknown: --up",
    recognized_by="JSON of cameras with K, RT, imgSize",
    matches=matches,
    read=read,
)
