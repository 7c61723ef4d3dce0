"""Conversion of the camera parameters of a file to a rig, shared by all calibration formats."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from posefuse.errors import CameraError, FileError, choices
from posefuse.io.calibration.tables import MAX_PLAUSIBLE, METERS_PER_UNIT, guess_unit
from posefuse.io.files import read_text
from posefuse.model.cameras import Camera, CameraRig, UpAxis
from posefuse.model.options.options import LengthUnit

LARGEST_BYTES = 8_000_000
"""Largest size of a calibration file; larger files are not read."""

_MAX_NUMBERS = 1_000_000


@dataclass(frozen=True)
class CameraRecord:
    """Parameters of a camera as read from a file, in the file's unit of length.

    Attributes:
        name: name of the camera.
        matrix: camera matrix K, 9 numbers in row order.
        rotation: world to camera, a Rodrigues vector or a matrix in row order.
        translation: world to camera, 3 numbers.
        distortion: coefficients in OpenCV's order.
        size_px: width and height of the image, or None if the file does not state them.
        fisheye: whether the coefficients belong to OpenCV's fisheye model.
    """

    name: str
    matrix: Any
    rotation: Any
    translation: Any
    distortion: Any = ()
    size_px: Sequence[float] | None = None
    fisheye: bool = False


def build_rig(
    path: Path,
    records: Sequence[CameraRecord],
    unit: LengthUnit | None,
    default_unit: LengthUnit | None,
    up: UpAxis | None = None,
    notes: tuple[str, ...] = (),
) -> CameraRig:
    """Build a rig, in meters.

    An unknown image size is assumed to be twice the principal point.

    Args:
        path: the file or folder, for messages.
        records: the cameras, in order.
        unit: unit of length stated by the user, or None.
        default_unit: unit of length of the format; None if the format leaves it open. Then it is guessed (see
            :func:`posefuse.io.calibration.tables.guess_unit`), and the rig has a note.
        up: up axis of the world, or None if unknown.
        notes: further notes of the rig.

    Raises:
        FileError: if there is no camera, or a field does not hold the right number of numbers.
        CameraError: if a camera's parameters are invalid.
    """
    if not records:
        raise FileError(f"{path} has no camera with both intrinsic and extrinsic parameters.")
    rows = [_numbers(path, camera) for camera in records]
    chosen = unit or default_unit
    if chosen is None:
        chosen = guess_unit((row.rotation, row.translation) for row in rows)
        notes = (
            *notes,
            f"{path.name} does not specify its unit of length; assumed {chosen}. Set it with `length_unit`.",
        )
    sizeless = [camera.name for camera in records if camera.size_px is None]
    if sizeless:
        notes = (
            *notes,
            f"{path.name} does not specify the image size of {choices(sizeless)}; assumed twice the principal point.",
        )
    scale = METERS_PER_UNIT[chosen]
    cameras = tuple(_camera(path, camera, row, scale) for camera, row in zip(records, rows, strict=True))
    return CameraRig(cameras, up, path.name, scale, notes)


@dataclass(frozen=True)
class _Numbers:
    matrix: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    distortion: np.ndarray


def _numbers(path: Path, camera: CameraRecord) -> _Numbers:
    counts = {"matrix": (9,), "rotation": (3, 9), "translation": (3,), "distortion": None}
    arrays = {}
    for field, sizes in counts.items():
        values = as_numbers(getattr(camera, field), f"{path}, camera {camera.name!r}: {field}")
        if sizes is not None and values.size not in sizes:
            raise FileError(
                f"{path}, camera {camera.name!r}: {field} must contain {' or '.join(map(str, sizes))} numbers, got "
                f"{values.size}."
            )
        arrays[field] = values
    arrays["matrix"] = arrays["matrix"].reshape(3, 3)
    if arrays["rotation"].size == 9:
        arrays["rotation"] = arrays["rotation"].reshape(3, 3)
    return _Numbers(**arrays)


def as_numbers(values: Any, where: str) -> np.ndarray:
    """Return values as a flat array of finite numbers; booleans are not accepted.

    Raises:
        FileError: if the values are not numbers, or implausibly large.
    """
    try:
        given = np.asarray(values)
        if given.dtype == bool or given.size > _MAX_NUMBERS:
            raise TypeError
        numbers = given.astype(np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        raise FileError(f"{where} must consist of numbers, got {_short(values)}.") from None
    if not np.all(np.abs(numbers) < MAX_PLAUSIBLE):
        raise FileError(f"{where} has implausible values: {_short(numbers.tolist())}.")
    return numbers


def _short(values: Any) -> str:
    text = repr(values)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _camera(path: Path, camera: CameraRecord, row: _Numbers, scale: float) -> Camera:
    if camera.size_px is None:
        size = np.maximum(np.round(2.0 * row.matrix[:2, 2]), 1.0)
    else:
        size = as_numbers(camera.size_px, f"{path}, camera {camera.name!r}: image size")
    if size.size != 2:
        raise FileError(f"{path}, camera {camera.name!r}: image size must contain 2 numbers, got {size.size}.")
    try:
        return Camera.from_opencv(
            camera.name, (size[0], size[1]), row.matrix, row.distortion, row.rotation, row.translation * scale,
            fisheye=camera.fisheye,
        )  # fmt: skip
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from None


def small_text(path: Path) -> str:
    """Return the text of a file that may be a calibration; empty if it is too large for one.

    Raises:
        FileError: if it cannot be read as UTF-8.
    """
    try:
        small = path.is_file() and path.stat().st_size <= LARGEST_BYTES
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}.") from None
    return read_text(path) if small else ""


def read_json(path: Path) -> Any:
    """Return the content of a JSON file; None if it is too large to be a calibration.

    Raises:
        FileError: if it is not JSON.
    """
    text = small_text(path)
    if not text:
        return None
    try:
        return msgspec.json.decode(text)
    except msgspec.DecodeError:
        pass  # Some programs write NaN, which is not valid JSON, but the standard library accepts it.
    except RecursionError as error:
        raise FileError(f"{path} is not valid JSON: {error}. Is it truncated?") from None
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path} is not valid JSON: {error}. Is it truncated?") from None


def json_matches(path: Path) -> Any:
    """Return the content of a file named ``.json``, for recognizing formats; None for any other file."""
    return read_json(path) if path.suffix == ".json" and path.is_file() else None


def dict_list(data: Any, key: str) -> list[dict[str, Any]]:
    """Return the list of objects at a key; empty if there is none."""
    values = data.get(key) if isinstance(data, dict) else None
    if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
        return []
    return values
