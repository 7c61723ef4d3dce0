"""What the TOML calibrations share: a table a camera, in OpenCV's numbers."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import CameraError, FileError, choices
from posefuse.io.files import natural_key
from posefuse.model.cameras import Camera, CameraRig, rotation_from_vector, vector_from_rotation
from posefuse.model.options.options import LengthUnit

METRES: dict[LengthUnit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}

BEYOND_REASON = 1e15
"""No number of a camera is as large."""

# Cameras do not stand a few millimetres apart: numbers this small are metres.
_METRES_BELOW = 30.0

_NO_CAMERAS = ("metadata", "capture_volume", "charuco", "checkerboard")
_NEEDED = ("matrix", "rotation", "translation", "size", "distortions")


def camera_tables(data: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The tables that describe cameras, in the order that counts (``cam_2`` before ``cam_10``)."""
    tables = {
        key: table
        for key, table in data.items()
        if isinstance(table, dict) and key not in _NO_CAMERAS and ("matrix" in table or "rotation" in table)
    }
    return {key: tables[key] for key in sorted(tables, key=natural_key)}


def camera_from_table(path: Path, key: str, table: Mapping[str, Any], metres_per_unit: float) -> Camera:
    """A camera from its table.

    Raises:
        FileError: if a key is missing or holds something else than numbers of the right shape.
        CameraError: if the numbers cannot be a camera's.
    """
    missing = [name for name in _NEEDED if name not in table]
    if missing:
        raise FileError(f"{path}, table [{key}]: no {choices(missing)}; it has {choices(table)}.")
    name = str(table.get("name", key))
    if not isinstance(table.get("fisheye", False), bool):
        raise FileError(f"{path}, table [{key}]: fisheye is true or false, got {table['fisheye']!r}.")
    if any(_has_bool(table[field]) for field in _NEEDED):
        raise FileError(f"{path}, table [{key}]: one of {choices(_NEEDED)} is not made of numbers.")
    try:
        numbers = {field: np.asarray(table[field], dtype=np.float64) for field in _NEEDED}
    except (TypeError, ValueError, OverflowError):
        raise FileError(f"{path}, table [{key}]: one of {choices(_NEEDED)} is not made of numbers.") from None
    wild = [field for field in _NEEDED if np.any(np.abs(numbers[field]) >= BEYOND_REASON)]
    if wild:
        raise FileError(f"{path}, table [{key}]: {wild[0]} holds numbers that no camera has: {table[wild[0]]}.")
    for field, sizes in {"matrix": (9,), "rotation": (3, 9), "translation": (3,), "size": (2,)}.items():
        got = numbers[field].size
        if got not in sizes:
            wanted = " or ".join(map(str, sizes))
            raise FileError(f"{path}, table [{key}]: {field} should hold {wanted} numbers, got {got}.")
    try:
        return Camera.from_opencv(
            name,
            tuple(numbers["size"].ravel()),
            numbers["matrix"].reshape(3, 3),
            numbers["distortions"].ravel(),
            numbers["rotation"],
            numbers["translation"].ravel() * metres_per_unit,
            fisheye=bool(table.get("fisheye", False)),
        )
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from None


def table_from_camera(camera: Camera, distortion: Iterable[float]) -> dict[str, Any]:
    """The table of a camera, in metres, with these distortion coefficients."""
    return {
        "name": camera.name,
        "size": list(camera.size_px),
        "matrix": camera.matrix.tolist(),
        "distortions": list(distortion),
        "rotation": vector_from_rotation(camera.rotation).tolist(),
        "translation": camera.translation_m.tolist(),
    }


def texts(path: Path, metadata: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """A list of texts that ``[metadata]`` holds, empty where it does not.

    Raises:
        FileError: if it holds something else.
    """
    values = metadata.get(key, [])
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise FileError(f"{path}: metadata.{key} should be a list of texts, got {values!r}.")
    return tuple(values)


def told(rig: CameraRig) -> dict[str, list[str]]:
    """What ``[metadata]`` says of a rig for :func:`texts`."""
    every = {"left_out": list(rig.left_out), "notes": list(rig.notes)}
    return {key: values for key, values in every.items() if values}


def _has_bool(value: Any) -> bool:
    return any(map(_has_bool, value)) if isinstance(value, list) else isinstance(value, bool)


def guessed_unit(poses: Iterable[tuple[Any, Any]]) -> LengthUnit:
    """The unit of a file that does not say: metres, where the cameras stand less than 30 units apart, else mm.

    Args:
        poses: rotation (vector or matrix) and translation of each camera, world to camera; where one is none of
            these, nothing is said of the distance.
    """
    centres = []
    for rotation, translation in poses:
        try:
            turn = np.asarray(rotation, dtype=np.float64)
            if np.any(np.abs([*turn.ravel(), *np.ravel(translation)]) >= BEYOND_REASON):
                return "mm"
            matrix = rotation_from_vector(turn.ravel()) if turn.size == 3 else turn.reshape(3, 3)
            centres.append(-matrix.T @ np.asarray(translation, dtype=np.float64).reshape(3))
        except (TypeError, ValueError, OverflowError):
            return "mm"
    points = np.array(centres).reshape(-1, 3)
    widest = np.linalg.norm(points[:, None] - points[None], axis=-1).max(initial=0.0)
    return "m" if 0.0 < widest < _METRES_BELOW else "mm"
