"""The scene JSON of the articulated tracker's specification and of RapidPoseTriangulation.

``cameras`` is a list of objects: ``name``, ``K``, ``DC`` (or ``distortion``), ``R`` (or ``rvec``), ``T``, ``width``
and ``height``, ``type`` (``pinhole`` or ``fisheye``); meters. ``extrinsic_format``, of the file or of a camera,
defines R and T: ``opencv_world_to_camera`` (the default, as from solvePnP) or ``rpt_camera_pose``, the camera's pose
in the world, with the transposed rotation and the camera's position. Scene files without this key that list images
(``imgpaths``) are old files of the second kind. A file may also hold the frames of a replay
(:mod:`posefuse.io.keypoints.replay`); they are skipped.
"""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from posefuse.errors import FileError, suggestion
from posefuse.io.calibration.camera_records import (
    CameraRecord,
    as_numbers,
    build_rig,
    dict_list,
    read_json,
)
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.model.cameras import CameraRig, rotation_from_vector
from posefuse.model.options.options import LengthUnit

_HEAD_BYTES = 1 << 16
FORMATS = ("opencv_world_to_camera", "rpt_camera_pose")


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    cameras = dict_list(_content(path), "cameras")
    return bool(cameras) and all({"K", "T"} <= set(c) and ("R" in c or "rvec" in c) for c in cameras)


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of the file.

    Raises:
        FileError: if the file does not conform to its format, or has an unsupported ``extrinsic_format``.
        CameraError: if a camera's parameters are invalid.
    """
    data = _content(path)
    if not isinstance(data, dict):
        raise FileError(f"{path} is not a scene: expected an object with a list of cameras.")
    default = data.get("extrinsic_format") or ("rpt_camera_pose" if "imgpaths" in data else FORMATS[0])
    records = [_camera(path, i, camera, default) for i, camera in enumerate(dict_list(data, "cameras"))]
    return build_rig(path, records, unit, "m")


def _content(path: Path) -> Any:
    """Return the content of a JSON file without the frames of a replay; None if it is no scene."""
    if path.suffix != ".json" or not path.is_file():
        return None
    with path.open("rb") as file:
        has_frames = b'"frames"' in file.read(_HEAD_BYTES)
    if not has_frames:
        return read_json(path)
    try:
        fields = msgspec.json.decode(path.read_bytes(), type=dict[str, msgspec.Raw])
        return {name: msgspec.json.decode(value) for name, value in fields.items() if name != "frames"}
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


def _camera(path: Path, index: int, camera: dict[str, Any], default: Any) -> CameraRecord:
    name = str(camera.get("name", index))
    where = f"{path}, camera {name!r}"
    kind = camera.get("extrinsic_format", default)
    if kind not in FORMATS:
        raise FileError(f"{where}: extrinsic_format is {kind!r}. {suggestion(str(kind), FORMATS)}")
    rotation = as_numbers(camera.get("R", camera.get("rvec")), f"{where}: R")
    translation = as_numbers(camera.get("T"), f"{where}: T")
    if kind == "rpt_camera_pose" and rotation.size in (3, 9) and translation.size == 3:
        turn = rotation_from_vector(rotation) if rotation.size == 3 else rotation.reshape(3, 3)
        rotation, translation = turn.T, -turn.T @ translation
    size = (camera["width"], camera["height"]) if {"width", "height"} <= set(camera) else None
    return CameraRecord(
        name,
        camera.get("K"),
        rotation,
        np.asarray(translation),
        camera.get("DC", camera.get("distortion", ())),
        size,
        fisheye=camera.get("type") == "fisheye",
    )


FORMAT = CalibrationFormat(
    name="scene",
    files="scene.json",
    conventions="meters; extrinsic_format states the direction; up axis unknown: `up`",
    recognized_by="JSON of a scene with extrinsics",
    matches=matches,
    read=read,
)
