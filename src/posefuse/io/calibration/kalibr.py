"""Kalibr's camchain YAML: ``cam0``, ``cam1``, ... with intrinsics, distortion and resolution; meters.

The world is the IMU if every camera has ``T_cam_imu``, otherwise the first camera, with ``T_cn_cnm1`` from each camera
to the next. Distortion models: ``radtan`` (``plumb_bob``), ``equidistant`` (fisheye), ``none``. The only supported
camera model is ``pinhole``.
"""

from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.calibration.camera_records import CameraRecord, as_numbers, build_rig
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.opencv_storage import read_yaml, yaml_matches
from posefuse.io.files import natural_key
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_LENSES = ("radtan", "plumb_bob", "equidistant", "none")


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    return bool(_cameras(yaml_matches(path)))


def _cameras(data: Any) -> dict[str, dict[str, Any]]:
    if not isinstance(data, dict):
        return {}
    records = {
        str(key): value
        for key, value in data.items()
        if isinstance(value, dict) and {"intrinsics", "camera_model"} <= set(value)
    }
    return {key: records[key] for key in sorted(records, key=natural_key)}


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of their numbers.

    Raises:
        FileError: if the file does not conform to its format, or a camera model is not supported.
        CameraError: if a camera's parameters are invalid.
    """
    tables = _cameras(read_yaml(path))
    poses = _poses(path, tables)
    records = [_camera(path, name, table, pose) for (name, table), pose in zip(tables.items(), poses, strict=True)]
    return build_rig(path, records, unit, "m")


def _poses(path: Path, tables: dict[str, dict[str, Any]]) -> list[np.ndarray]:
    """Return camera_from_world of each camera, shape (4, 4)."""
    if all("T_cam_imu" in table for table in tables.values()):
        return [_matrix(path, name, table, "T_cam_imu") for name, table in tables.items()]
    poses = []
    for name, table in tables.items():
        if not poses:
            poses.append(np.eye(4))
            continue
        if "T_cn_cnm1" not in table:
            raise FileError(f"{path}, {name}: T_cn_cnm1, the pose relative to the previous camera, is missing.")
        poses.append(_matrix(path, name, table, "T_cn_cnm1") @ poses[-1])
    return poses


def _matrix(path: Path, name: str, table: dict[str, Any], key: str) -> np.ndarray:
    values = as_numbers(table[key], f"{path}, {name}: {key}")
    if values.size != 16:
        raise FileError(f"{path}, {name}: {key} must contain 16 numbers, got {values.size}.")
    return values.reshape(4, 4)


def _camera(path: Path, name: str, table: dict[str, Any], pose: np.ndarray) -> CameraRecord:
    model, lens = table.get("camera_model"), table.get("distortion_model", "none")
    if model != "pinhole" or lens not in _LENSES:
        raise FileError(
            f"{path}, {name}: camera model {model!r} with distortion {lens!r} is not supported. Calibrate with pinhole "
            f"and one of {choices(_LENSES)}."
        )
    numbers = as_numbers(table.get("intrinsics"), f"{path}, {name}: intrinsics")
    if numbers.size != 4:
        raise FileError(f"{path}, {name}: intrinsics must contain fu fv pu pv, got {numbers.size} numbers.")
    fu, fv, pu, pv = numbers
    matrix = [[fu, 0.0, pu], [0.0, fv, pv], [0.0, 0.0, 1.0]]
    distortion = () if lens == "none" else table.get("distortion_coeffs", ())
    fisheye = lens == "equidistant"
    return CameraRecord(name, matrix, pose[:3, :3], pose[:3, 3], distortion, table.get("resolution"), fisheye=fisheye)


FORMAT = CalibrationFormat(
    name="kalibr",
    files="camchain*.yaml",
    conventions="meters; relative to the first camera or the IMU; up axis unknown: `up`",
    recognized_by="YAML of cam0, cam1, ... with camera_model",
    matches=matches,
    read=read,
)
