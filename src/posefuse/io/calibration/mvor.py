"""MVOR's ``camma_mvor_2018.json``: mm; the world is the first camera; poses are camera to world.

The images are rectified, so the stored distortion of the sensors is not used.
"""

from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.calibration.camera_records import (
    CameraRecord,
    as_numbers,
    build_rig,
    dict_list,
    json_matches,
    read_json,
)
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_LENS = ("focallength", "principalpoint", "imagesize")


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    parameters = _parameters(json_matches(path))
    return bool(dict_list(parameters, "intrinsics")) and isinstance(parameters.get("extrinsics"), list)


def _parameters(data: Any) -> dict[str, Any]:
    info = data.get("cameras_info") if isinstance(data, dict) else None
    parameters = info.get("camParams") if isinstance(info, dict) else None
    return parameters if isinstance(parameters, dict) else {}


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of the file: ``camera_1``, ``camera_2``, ...

    Raises:
        FileError: if the file does not conform to its format.
        CameraError: if a camera's parameters are invalid.
    """
    parameters = _parameters(read_json(path))
    lenses, poses = dict_list(parameters, "intrinsics"), parameters.get("extrinsics")
    if not isinstance(poses, list) or len(poses) != len(lenses):
        raise FileError(
            f"{path}: {len(lenses)} cameras have intrinsics; extrinsics must contain one pose for each of them."
        )
    records = [_camera(path, f"camera_{v}", *each) for v, each in enumerate(zip(lenses, poses, strict=True), start=1)]
    return build_rig(path, records, unit, "mm", notes=("The images are rectified; the stored distortion is not used.",))


def _camera(path: Path, name: str, lens: dict[str, Any], pose: Any) -> CameraRecord:
    where = f"{path}, camera {name!r}"
    numbers = [as_numbers(lens.get(key, ()), f"{where}: {key}") for key in _LENS]
    if any(each.size != 2 for each in numbers):
        raise FileError(f"{where}: {', '.join(_LENS)} must contain 2 numbers each.")
    first_from_camera = as_numbers(pose, f"{where}: extrinsics")
    if first_from_camera.size != 16:
        raise FileError(f"{where}: extrinsics must contain 16 numbers, got {first_from_camera.size}.")
    first_from_camera = first_from_camera.reshape(4, 4)
    rotation = first_from_camera[:3, :3].T
    (fx, fy), (cx, cy), size = numbers
    skew = as_numbers(lens.get("skew_value", 0.0), f"{where}: skew_value").sum()
    matrix = np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return CameraRecord(name, matrix, rotation, -rotation @ first_from_camera[:3, 3], (), size.tolist())


FORMAT = CalibrationFormat(
    name="mvor",
    files="camma_mvor_2018.json",
    conventions=(
        "mm; camera to first camera; rectified images, the stored distortion is not used; up axis unknown: `up`"
    ),
    recognized_by="JSON with cameras_info.camParams",
    matches=matches,
    read=read,
)
