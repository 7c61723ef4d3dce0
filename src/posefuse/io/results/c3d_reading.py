"""Reading C3D: the points of any program's file, without its analogue channels.

Layout after the C3D user guide (C3D.org): a header of 512 bytes, parameters in blocks of 512 bytes, then of each frame
four numbers a point (x, y, z, and a word: camera bits in its high byte, the residual in its low one; negative where the
point is missing) and the analogue samples. Whole numbers or floats, of Intel's, DEC's or MIPS' bytes. ezc3d, which
writes, is not asked to read: files with changed bytes keep it busy for ever. Here every size is checked against the
file's.
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
_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_CAMERA_BITS = 7
_MORE = 20
"""A list is continued as LABELS2, LABELS3, ...: so many are looked for."""

_Parameters = Mapping[tuple[str, str], np.ndarray | list[str]]


@dataclass(frozen=True)
class Points:
    """What a C3D file says of its points.

    Attributes:
        names: of the points, as written.
        first: number of the first frame, from 0.
        rate_hz: frames per second.
        points: shape (frame, point, 3), in ``unit``, in the file's axes; NaN where missing.
        residual: shape (frame, point), in the file's unit, -1 where missing.
        cameras: shape (frame, point, 7), bool: which of the first seven cameras saw it.
        unit: ``m``, into which cm and mm are turned; empty where the file does not say.
        up: the up axis that the file says, or None.
        layer: which layer posefuse wrote; empty of other programs.
        view_names: of the cameras that posefuse names; of other programs none.
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
        """Shape (frame,): number of the frame by the rate."""
        return (self.first + np.arange(len(self.points))) / self.rate_hz


def matches(path: Path) -> bool:
    """Whether a file is one."""
    with path.open("rb") as content:
        start = content.read(2)
    return len(start) == 2 and start[1] == _KEY


def read(path: Path) -> Points:
    """Read a C3D file of any program.

    Raises:
        FileError: if it is cut short, or not what the format says.
    """
    with reading(path, "C3D file"):
        return _read(path, path.read_bytes())


def read_points(path: Path) -> StoredPoints:
    """The points of a C3D file of any program, of one person, who is called as the file is; in the file's axes.

    Views are counted by the file's camera bits, where posefuse wrote it of up to seven cameras.

    Raises:
        FileError: if it is cut short, or not what the format says.
    """
    found = read(path)
    counted = 0 < len(found.view_names) <= _CAMERA_BITS
    return StoredPoints(
        keypoints=found.names,
        person_ids=(path.stem,),
        frame_numbers=found.first + np.arange(len(found.points)),
        time_s=found.time_s,
        points_m=found.points[:, None],
        unit=found.unit,
        layer=found.layer,
        rate_hz=found.rate_hz,
        n_views=found.cameras.sum(axis=-1)[:, None] if counted else None,
    )


def _read(path: Path, data: bytes) -> Points:
    if len(data) < _BLOCK or data[1] != _KEY:
        raise FileError(f"{path} is not a C3D file: its second byte should be 0x50.")
    start = (data[0] - 1) * _BLOCK
    processor = data[start + 3]
    if processor not in (_INTEL, _DEC, _MIPS):
        raise FileError(f"{path}: a C3D file of processor {processor}; known are 84 (Intel), 85 (DEC), 86 (MIPS).")
    known = _parameters(data[start + 4 :], processor)
    head = np.frombuffer(data[:_BLOCK], _order(processor) + "u2")
    rate = _number(known, ("POINT", "RATE")) or float(_floats(data[20:24], processor)[0])
    if not (math.isfinite(rate) and rate > 0):
        raise FileError(f"{path}: POINT:RATE should be positive, got {rate}.")
    first, n_frames = _frames(known, head)
    n_points, n_analogue = int(head[1]), int(head[2])
    scale = _number(known, ("POINT", "SCALE")) or float(_floats(data[12:16], processor)[0])
    values = _values(path, data, head, processor, scale, (n_frames, n_points, n_analogue))
    word = np.nan_to_num(values[..., 3], nan=-1.0, posinf=-1.0, neginf=-1.0)
    missing = (word < 0) | ~np.isfinite(values[..., :3]).all(axis=-1)
    bits = np.where(missing, 0.0, np.clip(word, 0.0, 32767.0)).astype(np.int64)
    unit = _text(known, ("POINT", "UNITS")).strip().lower()
    points = values[..., :3] * _METRES.get(unit, 1.0)
    said = _text(known, ("POINT", "Y_SCREEN")).strip().lower().removeprefix("+")
    layer = _text(known, ("POSEFUSE", "LAYER")).strip()
    return Points(
        names=_names(known, n_points),
        first=first,
        rate_hz=rate,
        points=np.where(missing[..., None], np.nan, points),
        residual=np.where(missing, -1.0, (bits & 255) * abs(scale)),
        cameras=(bits[..., None] >> np.arange(8, 8 + _CAMERA_BITS)) & 1 == 1,
        unit="m" if unit in _METRES else "",
        up=next((axis for axis in UP_AXES if axis == said), None),
        layer=layer if layer in LAYERS else "",
        view_names=tuple(_texts(known, ("POSEFUSE", "VIEWS"))),
    )


def _order(processor: int) -> str:
    return ">" if processor == _MIPS else "<"


def _floats(content: bytes, processor: int) -> np.ndarray:
    """Floats of a processor's bytes as float64."""
    if processor != _DEC:
        return np.frombuffer(content, _order(processor) + "f4").astype(np.float64)
    # DEC's F float is the word-swapped IEEE float, times four.
    swapped = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1]
    return np.ascontiguousarray(swapped).view("<f4").ravel().astype(np.float64) / 4.0


def _frames(known: _Parameters, head: np.ndarray) -> tuple[int, int]:
    """Number of the first frame, from 0, and how many there are: more than the header can count by TRIAL's fields."""
    first, last = int(head[3]), int(head[4])
    fields = [known.get(("TRIAL", f"ACTUAL_{end}_FIELD")) for end in ("START", "END")]
    if all(isinstance(field, np.ndarray) and field.size == 2 for field in fields):
        first, last = (int(low) % 65536 + 65536 * (int(high) % 65536) for low, high in fields)  # type: ignore[misc]
    return max(first - 1, 0), max(last - first + 1, 0)


def _values(
    path: Path, data: bytes, head: np.ndarray, processor: int, scale: float, counts: tuple[int, int, int]
) -> np.ndarray:
    """Shape (frame, point, 4): x, y, z in the file's unit, and the word of residual and cameras."""
    n_frames, n_points, n_analogue = counts
    start, width = (int(head[8]) - 1) * _BLOCK, 4 if scale < 0 else 2
    each = 4 * n_points + n_analogue
    n_bytes = n_frames * each * width
    if start < _BLOCK or start + n_bytes > len(data):
        raise FileError(
            f"{path} should hold {n_bytes} bytes of {n_frames} frames from byte {start} on, and has {len(data)} bytes. "
            "Was it cut short?"
        )
    content = data[start : start + n_bytes]
    if scale < 0:
        return _floats(content, processor).reshape(n_frames, each)[:, : 4 * n_points].reshape(n_frames, n_points, 4)
    whole = np.frombuffer(content, _order(processor) + "i2").reshape(n_frames, each)[:, : 4 * n_points]
    values = whole.reshape(n_frames, n_points, 4).astype(np.float64)
    values[..., :3] *= scale
    return values


def _parameters(data: bytes, processor: int) -> dict[tuple[str, str], np.ndarray | list[str]]:
    """Parameters by the names of their group and their own."""
    groups: dict[int, str] = {}
    found: list[tuple[int, str, np.ndarray | list[str]]] = []
    for number, name, content in _records(data, processor):
        if number < 0:
            groups[-number] = name
        else:
            found.append((number, name, _parameter(content, processor)))
    return {(groups[number], name): value for number, name, value in found if number in groups}


def _records(data: bytes, processor: int) -> Iterator[tuple[int, str, bytes]]:
    """Number, name and content of one group or parameter after the other."""
    at = 0
    while at + 2 < len(data):
        length, number = struct.unpack_from("bb", data, at)
        length = abs(length)  # negative of what is locked
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
    """Numbers in the order of the file, or texts."""
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


def _number(known: _Parameters, name: tuple[str, str]) -> float:
    """The first number of a parameter; 0 where there is none."""
    values = known.get(name)
    return float(values[0]) if isinstance(values, np.ndarray) and values.size else 0.0


def _texts(known: _Parameters, name: tuple[str, str]) -> list[str]:
    """The texts of a parameter and of those that continue it."""
    group, own = name
    parts: list[Any] = [known.get((group, own if i == 1 else f"{own}{i}")) for i in range(1, _MORE)]
    return [text for part in parts if isinstance(part, list) for text in part]


def _text(known: _Parameters, name: tuple[str, str]) -> str:
    return next(iter(_texts(known, name)), "")


def _names(known: _Parameters, n_points: int) -> tuple[str, ...]:
    """The labels; of points without one, ``point_<number>``."""
    labels = _texts(known, ("POINT", "LABELS"))[:n_points]
    labels += [""] * (n_points - len(labels))
    return tuple(label.strip() or f"point_{i}" for i, label in enumerate(labels))
