"""Functions shared by the TOML calibrations: one table per camera, with OpenCV's conventions."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import CameraError, FileError, choices
from posefuse.io.files import natural_key
from posefuse.model.cameras import Camera, CameraRig, rotation_from_vector, vector_from_rotation
from posefuse.model.options.options import LengthUnit

METERS_PER_UNIT: dict[LengthUnit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}

MAX_PLAUSIBLE = 1e15
"""Camera parameters are smaller than this."""

_MAX_DISTANCE_IN_METERS = 30.0
"""Cameras are never only a few millimeters apart, so smaller distances are in meters."""

_NO_CAMERAS = ("metadata", "capture_volume", "charuco", "checkerboard")
_NEEDED = ("matrix", "rotation", "translation", "size", "distortions")


def camera_tables(data: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the tables of cameras in natural order (``cam_2`` before ``cam_10``)."""
    tables = {
        key: table
        for key, table in data.items()
        if isinstance(table, dict) and key not in _NO_CAMERAS and ("matrix" in table or "rotation" in table)
    }
    return {key: tables[key] for key in sorted(tables, key=natural_key)}


def camera_from_table(path: Path, key: str, table: Mapping[str, Any], meters_per_unit: float) -> Camera:
    """Return the camera of a table.

    Raises:
        FileError: if a key is missing, or its value does not consist of numbers of the right shape.
        CameraError: if the parameters are invalid.
    """
    missing = [name for name in _NEEDED if name not in table]
    if missing:
        raise FileError(f"{path}, table [{key}] has no {choices(missing)}; it has {choices(table)}.")
    name = str(table.get("name", key))
    if not isinstance(table.get("fisheye", False), bool):
        raise FileError(f"{path}, table [{key}]: fisheye must be true or false, got {table['fisheye']!r}.")
    numbers = {field: _numbers(table[field], f"{path}, table [{key}]: {field}") for field in _NEEDED}
    extreme = [field for field in _NEEDED if np.any(np.abs(numbers[field]) >= MAX_PLAUSIBLE)]
    if extreme:
        raise FileError(f"{path}, table [{key}]: {extreme[0]} has implausible values: {table[extreme[0]]}.")
    for field, sizes in {"matrix": (9,), "rotation": (3, 9), "translation": (3,), "size": (2,)}.items():
        got = numbers[field].size
        if got not in sizes:
            expected = " or ".join(map(str, sizes))
            raise FileError(f"{path}, table [{key}]: {field} must contain {expected} numbers, got {got}.")
    try:
        return Camera.from_opencv(
            name,
            tuple(numbers["size"].ravel()),
            numbers["matrix"].reshape(3, 3),
            numbers["distortions"].ravel(),
            numbers["rotation"],
            numbers["translation"].ravel() * meters_per_unit,
            fisheye=bool(table.get("fisheye", False)),
        )
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from None


def table_from_camera(camera: Camera, distortion: Iterable[float]) -> dict[str, Any]:
    """Return the table of a camera, in meters, with the given distortion coefficients."""
    return {
        "name": camera.name,
        "size": list(camera.size_px),
        "matrix": camera.matrix.tolist(),
        "distortions": list(distortion),
        "rotation": vector_from_rotation(camera.rotation).tolist(),
        "translation": camera.translation_m.tolist(),
    }


def texts(path: Path, metadata: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """Return a list of texts in ``[metadata]``; empty if there is none.

    Raises:
        FileError: if the value is not a list of texts.
    """
    values = metadata.get(key, [])
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise FileError(f"{path}: metadata.{key} must be a list of strings, got {values!r}.")
    return tuple(values)


def metadata_texts(rig: CameraRig) -> dict[str, list[str]]:
    """Return the notes of a rig as entries of ``[metadata]``, which :func:`texts` reads."""
    entries = {"left_out": list(rig.left_out), "notes": list(rig.notes)}
    return {key: values for key, values in entries.items() if values}


def _numbers(value: Any, what: str) -> np.ndarray:
    """Return a value of a file as an array; booleans are not numbers."""
    try:
        if not _has_bool(value):
            return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    raise FileError(f"{what} must consist of numbers, got {repr(value)[:60]}.")


def _has_bool(value: Any) -> bool:
    return any(map(_has_bool, value)) if isinstance(value, list) else isinstance(value, bool)


def guess_unit(poses: Iterable[tuple[Any, Any]]) -> LengthUnit:
    """Guess the unit of a file that does not state it: meters if all cameras are within 30 units, otherwise mm.

    Args:
        poses: rotation (vector or matrix) and translation of each camera, world to camera. If one is invalid, the
            unit is mm.
    """
    centers = []
    for rotation, translation in poses:
        try:
            turn = np.asarray(rotation, dtype=np.float64)
            if np.any(np.abs([*turn.ravel(), *np.ravel(translation)]) >= MAX_PLAUSIBLE):
                return "mm"
            matrix = rotation_from_vector(turn.ravel()) if turn.size == 3 else turn.reshape(3, 3)
            centers.append(-matrix.T @ np.asarray(translation, dtype=np.float64).reshape(3))
        except (TypeError, ValueError, OverflowError):
            return "mm"
    points = np.array(centers).reshape(-1, 3)
    widest = np.linalg.norm(points[:, None] - points[None], axis=-1).max(initial=0.0)
    return "m" if 0.0 < widest < _MAX_DISTANCE_IN_METERS else "mm"
