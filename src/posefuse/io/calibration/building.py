"""From the numbers of a file to a rig: what every calibration format needs and none should do by itself."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from posefuse.errors import CameraError, FileError, choices
from posefuse.io.calibration.tables import BEYOND_REASON, METRES, guessed_unit
from posefuse.io.files import read_text
from posefuse.model.cameras import Camera, CameraRig, UpAxis
from posefuse.model.options.options import LengthUnit

LARGEST_BYTES = 8_000_000
"""No calibration is larger; what is, is something else, or a trap."""

_MOST_NUMBERS = 1_000_000


@dataclass(frozen=True)
class Found:
    """A camera as a file describes it, in the file's unit of length.

    Attributes:
        name: its name.
        matrix: K, 9 numbers in rows.
        rotation: world to camera, a Rodrigues vector or a matrix in rows.
        translation: world to camera, 3 numbers.
        distortion: in OpenCV's order.
        size_px: width and height, or None where the file does not say.
        fisheye: whether the coefficients are a fisheye's.
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
    found: Sequence[Found],
    unit: LengthUnit | None,
    usual: LengthUnit | None,
    up: UpAxis | None = None,
    notes: tuple[str, ...] = (),
) -> CameraRig:
    """The rig of what was found.

    An image whose size is not said is taken to be twice as wide and high as the principal point lies inside it.

    Args:
        path: the file or folder, for messages.
        found: the cameras, in order.
        unit: what the user says the lengths are in.
        usual: what the format says; None where it leaves that open: then metres, where the cameras stand less than 30
            units apart, else mm, and a note.
        up: the world's up axis, or None where nobody knows.
        notes: what else is worth saying.

    Raises:
        FileError: if no camera was found, or something is not made of numbers of the right count.
        CameraError: if a camera's numbers cannot be.
    """
    if not found:
        raise FileError(f"{path} describes no camera that has both a lens and a place.")
    rows = [_numbers(path, camera) for camera in found]
    chosen = unit or usual
    if chosen is None:
        chosen = guessed_unit((row.rotation, row.translation) for row in rows)
        notes = (
            *notes,
            f"{path.name} does not say its unit of length; read as {chosen}. --length-unit says otherwise.",
        )
    sizeless = [camera.name for camera in found if camera.size_px is None]
    if sizeless:
        notes = (
            *notes,
            f"{path.name} does not say how large the images of {choices(sizeless)} are; taken as twice the principal "
            "point.",
        )
    cameras = tuple(_camera(path, camera, row, METRES[chosen]) for camera, row in zip(found, rows, strict=True))
    return CameraRig(cameras, up, path.name, METRES[chosen], notes)


@dataclass(frozen=True)
class _Numbers:
    matrix: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    distortion: np.ndarray


def _numbers(path: Path, camera: Found) -> _Numbers:
    counts = {"matrix": (9,), "rotation": (3, 9), "translation": (3,), "distortion": None}
    arrays = {}
    for field, wanted in counts.items():
        values = as_numbers(getattr(camera, field), f"{path}, camera {camera.name!r}: {field}")
        if wanted is not None and values.size not in wanted:
            raise FileError(
                f"{path}, camera {camera.name!r}: {field} should hold {' or '.join(map(str, wanted))} numbers, got "
                f"{values.size}."
            )
        arrays[field] = values
    arrays["matrix"] = arrays["matrix"].reshape(3, 3)
    if arrays["rotation"].size == 9:
        arrays["rotation"] = arrays["rotation"].reshape(3, 3)
    return _Numbers(**arrays)


def as_numbers(values: Any, where: str) -> np.ndarray:
    """Values as a flat array of finite numbers; truth values are none.

    Raises:
        FileError: if they are something else, or beyond all reason.
    """
    try:
        given = np.asarray(values)
        if given.dtype == bool or given.size > _MOST_NUMBERS:
            raise TypeError
        numbers = given.astype(np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        raise FileError(f"{where} should be made of numbers, got {_short(values)}.") from None
    if not np.all(np.abs(numbers) < BEYOND_REASON):
        raise FileError(f"{where} holds numbers that no camera has: {_short(numbers.tolist())}.")
    return numbers


def _short(values: Any) -> str:
    text = repr(values)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _camera(path: Path, camera: Found, row: _Numbers, scale: float) -> Camera:
    if camera.size_px is None:
        size = np.maximum(np.round(2.0 * row.matrix[:2, 2]), 1.0)
    else:
        size = as_numbers(camera.size_px, f"{path}, camera {camera.name!r}: image size")
    if size.size != 2:
        raise FileError(f"{path}, camera {camera.name!r}: image size should hold 2 numbers, got {size.size}.")
    try:
        return Camera.from_opencv(
            camera.name, (size[0], size[1]), row.matrix, row.distortion, row.rotation, row.translation * scale,
            fisheye=camera.fisheye,
        )  # fmt: skip
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from None


def small_text(path: Path) -> str:
    """The text of a file that may be a calibration; nothing of a file that is too large for one.

    Raises:
        FileError: if it cannot be read as UTF-8.
    """
    try:
        small = path.is_file() and path.stat().st_size <= LARGEST_BYTES
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}.") from None
    return read_text(path) if small else ""


def read_json(path: Path) -> Any:
    """What a JSON file holds; None for a file that is too large to be a calibration.

    Raises:
        FileError: if it is not JSON.
    """
    text = small_text(path)
    if not text:
        return None
    try:
        return msgspec.json.decode(text)
    except msgspec.DecodeError:
        pass  # Some programs write NaN, which is not JSON but is clear enough.
    except RecursionError as error:
        raise FileError(f"{path} is not whole JSON: {error}. Was it cut short?") from None
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path} is not whole JSON: {error}. Was it cut short?") from None


def json_matches(path: Path) -> Any:
    """What a file named ``.json`` holds, for a format to look whether it is its own; None for any other file."""
    return read_json(path) if path.suffix == ".json" and path.is_file() else None


def dict_list(data: Any, key: str) -> list[dict[str, Any]]:
    """The list of objects under a key, empty where there is none."""
    values = data.get(key) if isinstance(data, dict) else None
    if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
        return []
    return values
