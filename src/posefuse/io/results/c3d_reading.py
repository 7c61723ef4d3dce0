"""Reading of the points of C3D files of any program; analog channels are ignored.

Layout after the C3D user guide (C3D.org): a header of 512 bytes, parameters in blocks of 512 bytes, then for each frame
four numbers per point (x, y, z, and a word with camera bits in its high byte and the residual in its low byte; negative
if the point is missing) and the analog samples. Numbers are integers or floats in the byte order of Intel, DEC or MIPS.

ezc3d, which writes C3D files, is not used for reading: it rejects files of MIPS processors and reads no frames from
some files with analog channels, see tests/unit/io/results/test_c3d_reading.py. This reader checks every size against
that of the file.
"""

import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import reading
from posefuse.model.cameras import UP_AXES, UpAxis
from posefuse.model.reconstruction import LAYERS
from posefuse.model.stored_points import StoredPoints

_BLOCK = 512
_KEY = 0x50
_INTEL, _DEC, _MIPS = 84, 85, 86
_TEXT, _BYTE, _INTEGER, _FLOAT = -1, 1, 2, 4
_METERS_PER_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_CAMERA_BITS = 7
_MAX_PARTS = 20
"""Largest number of parts of a list that is continued as LABELS2, LABELS3, ..."""

_Parameters = Mapping[tuple[str, str], np.ndarray | list[str]]


@dataclass(frozen=True)
class C3dContent:
    """The points of a C3D file.

    Attributes:
        names: names of the points as in the file.
        first: number of the first frame, from 0.
        rate_hz: frames per second.
        points: shape (frame, point, 3), in ``unit`` and the file's axes; NaN if missing.
        residual: shape (frame, point), in the file's unit, -1 where missing.
        cameras: shape (frame, point, 7), bool: which of the first seven cameras were used for the point.
        unit: ``m``, to which cm and mm are converted; empty if unknown.
        up: up axis stated by the file, or None.
        layer: layer written by posefuse; empty for files of other programs.
        view_names: names of the cameras written by posefuse; empty for files of other programs.
    """

    names: tuple[str, ...]
    first: int
    rate_hz: float
    points: np.ndarray
    residual: np.ndarray
    cameras: np.ndarray
    unit: str
    up: UpAxis | None
    layer: str
    view_names: tuple[str, ...]

    @property
    def time_s(self) -> np.ndarray:
        """Times of the frames, shape (frame,): frame number divided by the rate."""
        return (self.first + np.arange(len(self.points))) / self.rate_hz


def matches(path: Path) -> bool:
    """Return whether a file is in this format."""
    with path.open("rb") as content:
        start = content.read(2)
    return len(start) == 2 and start[1] == _KEY


def read(path: Path) -> C3dContent:
    """Read a C3D file of any program.

    Raises:
        FileError: if the file is truncated or does not conform to the format.
    """
    with reading(path, "C3D file"):
        return _read(path, path.read_bytes())


def read_points(path: Path) -> StoredPoints:
    """Read the points of a C3D file of any program as one person named after the file, in the file's axes.

    The number of views comes from the camera bits if posefuse wrote the file for up to seven cameras.

    Raises:
        FileError: if the file is truncated or does not conform to the format.
    """
    content = read(path)
    counted = 0 < len(content.view_names) <= _CAMERA_BITS
    return StoredPoints(
        keypoints=content.names,
        person_ids=(path.stem,),
        frame_numbers=content.first + np.arange(len(content.points)),
        time_s=content.time_s,
        points_m=content.points[:, None],
        unit=content.unit,
        layer=content.layer,
        rate_hz=content.rate_hz,
        n_views=content.cameras.sum(axis=-1)[:, None] if counted else None,
    )


def _read(path: Path, data: bytes) -> C3dContent:
    if len(data) < _BLOCK or data[1] != _KEY:
        raise FileError(f"{path} is not a C3D file: its second byte is not 0x50.")
    start = (data[0] - 1) * _BLOCK
    processor = data[start + 3]
    if processor not in (_INTEL, _DEC, _MIPS):
        raise FileError(f"{path}: unknown processor {processor}; expected 84 (Intel), 85 (DEC) or 86 (MIPS).")
    parameters = _parameters(data[start + 4 :], processor)
    head = np.frombuffer(data[:_BLOCK], _order(processor) + "u2")
    rate = _number(parameters, ("POINT", "RATE")) or float(_floats(data[20:24], processor)[0])
    if not (math.isfinite(rate) and rate > 0):
        raise FileError(f"{path}: POINT:RATE must be positive, got {rate}.")
    first, n_frames = _frames(parameters, head)
    n_points, n_analog = int(head[1]), int(head[2])
    scale = _number(parameters, ("POINT", "SCALE")) or float(_floats(data[12:16], processor)[0])
    values = _values(path, data, head, processor, scale, (n_frames, n_points, n_analog))
    word = np.nan_to_num(values[..., 3], nan=-1.0, posinf=-1.0, neginf=-1.0)
    missing = (word < 0) | ~np.isfinite(values[..., :3]).all(axis=-1)
    bits = np.where(missing, 0.0, np.clip(word, 0.0, 32767.0)).astype(np.int64)
    unit = _text(parameters, ("POINT", "UNITS")).strip().lower()
    points = values[..., :3] * _METERS_PER_UNIT.get(unit, 1.0)
    y_screen = _text(parameters, ("POINT", "Y_SCREEN")).strip().lower().removeprefix("+")
    layer = _text(parameters, ("POSEFUSE", "LAYER")).strip()
    return C3dContent(
        names=_names(parameters, n_points),
        first=first,
        rate_hz=rate,
        points=np.where(missing[..., None], np.nan, points),
        residual=np.where(missing, -1.0, (bits & 255) * abs(scale)),
        cameras=(bits[..., None] >> np.arange(8, 8 + _CAMERA_BITS)) & 1 == 1,
        unit="m" if unit in _METERS_PER_UNIT else "",
        up=next((axis for axis in UP_AXES if axis == y_screen), None),
        layer=layer if layer in LAYERS else "",
        view_names=tuple(_texts(parameters, ("POSEFUSE", "VIEWS"))),
    )


def _order(processor: int) -> str:
    return ">" if processor == _MIPS else "<"


def _floats(content: bytes, processor: int) -> np.ndarray:
    """Convert floats of a processor to float64."""
    if processor != _DEC:
        return np.frombuffer(content, _order(processor) + "f4").astype(np.float64)
    # DEC's F float is the word-swapped IEEE float, times four.
    swapped = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1]
    return np.ascontiguousarray(swapped).view("<f4").ravel().astype(np.float64) / 4.0


def _frames(parameters: _Parameters, head: np.ndarray) -> tuple[int, int]:
    """Return the number of the first frame, from 0, and of frames; TRIAL's fields override the 16-bit header."""
    first, last = int(head[3]), int(head[4])
    fields = [parameters.get(("TRIAL", f"ACTUAL_{end}_FIELD")) for end in ("START", "END")]
    if all(isinstance(field, np.ndarray) and field.size == 2 for field in fields):
        first, last = (int(low) % 65536 + 65536 * (int(high) % 65536) for low, high in fields)  # type: ignore[misc]
    return max(first - 1, 0), max(last - first + 1, 0)


def _values(
    path: Path, data: bytes, head: np.ndarray, processor: int, scale: float, counts: tuple[int, int, int]
) -> np.ndarray:
    """Return x, y, z in the file's unit and the word of residual and cameras, shape (frame, point, 4)."""
    n_frames, n_points, n_analog = counts
    start, width = (int(head[8]) - 1) * _BLOCK, 4 if scale < 0 else 2
    each = 4 * n_points + n_analog
    n_bytes = n_frames * each * width
    if start < _BLOCK or start + n_bytes > len(data):
        raise FileError(
            f"{path}: the header declares {n_bytes} bytes of {n_frames} frames starting at byte {start}, but the file "
            f"has {len(data)} bytes. Is it truncated?"
        )
    content = data[start : start + n_bytes]
    if scale < 0:
        return _floats(content, processor).reshape(n_frames, each)[:, : 4 * n_points].reshape(n_frames, n_points, 4)
    integers = np.frombuffer(content, _order(processor) + "i2").reshape(n_frames, each)[:, : 4 * n_points]
    values = integers.reshape(n_frames, n_points, 4).astype(np.float64)
    values[..., :3] *= scale
    return values


def _parameters(data: bytes, processor: int) -> dict[tuple[str, str], np.ndarray | list[str]]:
    """Return the parameters by group name and parameter name."""
    groups: dict[int, str] = {}
    numbered: list[tuple[int, str, np.ndarray | list[str]]] = []
    for number, name, content in _records(data, processor):
        if number < 0:
            groups[-number] = name
        else:
            numbered.append((number, name, _parameter(content, processor)))
    return {(groups[number], name): value for number, name, value in numbered if number in groups}


def _records(data: bytes, processor: int) -> Iterator[tuple[int, str, bytes]]:
    """Yield number, name and content of each group and parameter."""
    at = 0
    while at + 2 < len(data):
        length, number = struct.unpack_from("bb", data, at)
        length = abs(length)  # negative for locked entries
        if length == 0 or number == 0:
            return
        offset_at = at + 2 + length
        (offset,) = struct.unpack_from(_order(processor) + "H", data, offset_at)
        end = offset_at + offset if offset else len(data)
        yield number, data[at + 2 : offset_at].decode("latin1").upper(), data[offset_at + 2 : end]
        if not offset:
            return
        at = end


def _parameter(content: bytes, processor: int) -> np.ndarray | list[str]:
    """Return numbers in the order of the file, or strings."""
    kind, n_axes = struct.unpack_from("bB", content, 0)
    axes = list(content[2 : 2 + n_axes])
    size, values = math.prod(axes), content[2 + n_axes :]
    width = {_TEXT: 1, _BYTE: 1, _INTEGER: 2, _FLOAT: 4}[kind]
    if len(axes) < n_axes or len(values) < size * width:
        raise ValueError(f"a parameter of {size} values has {len(values)} bytes")
    values = values[: size * width]
    if kind == _TEXT:
        step = axes[0] if axes else 1
        return [values[i : i + step].decode("utf-8", "replace").rstrip(" \0") for i in range(0, size, step or 1)]
    if kind == _FLOAT:
        return _floats(values, processor)
    return np.frombuffer(values, "i1" if kind == _BYTE else _order(processor) + "i2")


def _number(parameters: _Parameters, name: tuple[str, str]) -> float:
    """Return the first number of a parameter; 0 if there is none."""
    values = parameters.get(name)
    return float(values[0]) if isinstance(values, np.ndarray) and values.size else 0.0


def _texts(parameters: _Parameters, name: tuple[str, str]) -> list[str]:
    """Return the strings of a parameter and its continuations."""
    group, first = name
    parts: list[Any] = [parameters.get((group, first if i == 1 else f"{first}{i}")) for i in range(1, _MAX_PARTS)]
    return [text for part in parts if isinstance(part, list) for text in part]


def _text(parameters: _Parameters, name: tuple[str, str]) -> str:
    return next(iter(_texts(parameters, name)), "")


def _names(parameters: _Parameters, n_points: int) -> tuple[str, ...]:
    """Return the labels; points without one are called ``point_<number>``."""
    labels = _texts(parameters, ("POINT", "LABELS"))[:n_points]
    labels += [""] * (n_points - len(labels))
    return tuple(label.strip() or f"point_{i}" for i, label in enumerate(labels))
