"""C3D, written with ezc3d: one file per person, mm, world axes; missing points have residual -1.

A point's residual is its standard deviation in mm (root mean square over the axes, steps of 0.1, at most 25.5). The
residual of a filled point is 0, the standard's mark of points that were not measured. Up to seven views set the
standard's camera bits; with more, POSEFUSE:MEAN_VIEWS is the mean number of views of each keypoint. More than 65,535
frames are written with the standard's extension, TRIAL:ACTUAL_END_FIELD; programs without support for it (such as
ezc3d) read the first 65,535. ezc3d writes the header and parameters only, because it would hold several copies of the
points in memory and stores the camera bits in the byte of the residual. :mod:`posefuse.io.results.c3d_reading` reads
C3D files.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import ezc3d
import numpy as np

from posefuse.errors import ResultError
from posefuse.io.files import replacing
from posefuse.io.results.c3d_reading import matches as matches
from posefuse.io.results.c3d_reading import read_points as read_points
from posefuse.io.results.format import ResultFormat
from posefuse.io.results.timing import export_rate, regular_rows
from posefuse.model.cameras import UpAxis
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import Source, is_used
from posefuse.progress import Progress, Silent, report_ranges

_CAMERA_BITS = 7
_RESIDUAL_STEP_MM = 0.1
_FRAMES_OF_HEADER = 65535
_INTEGER = 2
_BLOCK = 512
_MEAN_VIEWS = "MEAN_VIEWS"
_MISSING = np.array([0.0, 0.0, 0.0, -1.0], dtype="<f4")
_LONGEST_AXIS = 255
# World axis that points to the right on the screen.
_SCREEN_X: dict[UpAxis, str] = {"z": "+X", "y": "+X", "x": "+Y", "-z": "+X", "-y": "+X", "-x": "+Y"}


def write(result: Reconstruction, person: str, path: Path, layer: LayerName, progress: Progress | None = None) -> None:
    """Write one person.

    Raises:
        ResultError: if the frame rate is unknown or not constant, or the result is not in meters.
    """
    rate = export_rate(result, "C3D")
    if result.unit != "m":
        raise ResultError(
            f"A C3D file is in mm; this result is in {result.unit} (image plane of a single camera). Use TRC."
        )
    row_indices, n_rows = regular_rows(result)
    index, names = result.person_ids.index(person), result.skeleton.keypoints
    views = np.zeros(len(names))
    with replacing(path) as temporary:
        _header(result, layer, rate, n_rows).write(str(temporary))
        with temporary.open("r+b") as file:
            parameters = _parameters(file.read())
            start = _BLOCK * (parameters["POINT", "DATA_START"].integer - 1)
            _correct_header(file, parameters, n_rows, start + 16 * len(names) * n_rows)
            file.seek(start)
            done, row = 0, 0
            for part in report_ranges(result.windows(), result.n_frames, f"writing {path.name}", progress or Silent()):
                rows = row_indices[done : done + part.n_frames]
                block = np.tile(_MISSING, (int(rows[-1]) + 1 - row, len(names), 1))
                block[rows - row], used = _points_as_stored(part.layers[layer], index)
                file.write(block.tobytes())
                views += used.sum(axis=0)
                done, row = done + part.n_frames, int(rows[-1]) + 1
            file.write(bytes(_BLOCK - file.tell() % _BLOCK))
            _write_means(file, parameters, views / max(result.n_frames, 1))


def _header(result: Reconstruction, layer: LayerName, rate: float, n_rows: int) -> ezc3d.c3d:
    """Return the file's header and parameters with a single row of missing points."""
    names = result.skeleton.keypoints
    content = ezc3d.c3d()
    point = content["parameters"]["POINT"]
    point["RATE"]["value"] = [rate]
    point["UNITS"]["value"] = ["mm"]
    point["LABELS"]["value"] = list(names)
    point["SCALE"]["value"] = [-_RESIDUAL_STEP_MM]
    points = np.full((4, len(names), 1), np.nan)
    points[3] = 1.0
    nothing = np.full((1, len(names), 1), -1.0), np.zeros((_CAMERA_BITS, len(names), 1), dtype=bool)
    content["header"]["points"]["first_frame"] = _first_frame(result)
    content["data"]["points"] = points
    content["data"]["meta_points"] = dict(zip(("residuals", "camera_masks"), nothing, strict=True))
    content.add_parameter("POSEFUSE", "LAYER", [layer])
    _add_list(content, "VIEWS", list(result.rig.names))
    _add_list(content, _MEAN_VIEWS, [0.0] * len(names))
    _add_screen(content, result.rig.up_axis)
    if result.rig.inferred_up is not None:
        content.add_parameter("POSEFUSE", "UP_AXIS_SOURCE", ["inferred"])
    if n_rows > _FRAMES_OF_HEADER:
        _add_actual_fields(content, n_rows)
    return content


@dataclass(frozen=True)
class _Parameter:
    """Byte offset of a parameter's values, and the first of them as a 16-bit integer."""

    offset: int
    integer: int


def _parameters(content: bytes) -> dict[tuple[str, str], _Parameter]:
    """Return the parameters of a file written by ezc3d, by group and name."""
    groups: dict[int, str] = {}
    by_group: dict[tuple[int, str], _Parameter] = {}
    at = _BLOCK + 4
    while True:
        length, group = struct.unpack_from("bb", content, at)
        length = abs(length)
        if length == 0:
            break
        name = content[at + 2 : at + 2 + length].decode()
        (step,) = struct.unpack_from("<h", content, at + 2 + length)
        if group < 0:
            groups[-group] = name
        else:
            axes = content[at + 5 + length]
            offset = at + 6 + length + axes
            by_group[group, name] = _Parameter(offset, int.from_bytes(content[offset : offset + 2], "little"))
        at += 2 + length + step
    return {(groups[group], name): each for (group, name), each in by_group.items()}


def _correct_header(file: BinaryIO, parameters: Mapping[tuple[str, str], _Parameter], n_rows: int, stop: int) -> None:
    """Set the number of rows, whose data end before byte ``stop``, and copy POINT:SCALE to the header.

    ezc3d leaves -1 in the header, and strict readers compare the two.
    """
    first = struct.unpack("<H", _read_at(file, 6, 2))[0]
    last = min(first + n_rows - 1, _FRAMES_OF_HEADER)
    _write_at(file, 8, struct.pack("<H", last))
    _write_at(file, 12, struct.pack("<f", -_RESIDUAL_STEP_MM))
    _write_at(file, parameters["POINT", "FRAMES"].offset, struct.pack("<H", min(n_rows, _FRAMES_OF_HEADER)))
    # Like ezc3d, end the file with zeros up to the next block, even if the data end at a block boundary.
    after = stop // _BLOCK + 2
    _write_at(file, parameters["ROTATION", "DATA_START"].offset, struct.pack("<H", after % 65536))


def _write_means(file: BinaryIO, parameters: Mapping[tuple[str, str], _Parameter], means: np.ndarray) -> None:
    for part, start in enumerate(range(0, len(means), _LONGEST_AXIS), 1):
        name = _MEAN_VIEWS if part == 1 else f"{_MEAN_VIEWS}{part}"
        block = means[start : start + _LONGEST_AXIS].astype("<f4")
        _write_at(file, parameters["POSEFUSE", name].offset, block.tobytes())


def _read_at(file: BinaryIO, offset: int, size: int) -> bytes:
    file.seek(offset)
    return file.read(size)


def _write_at(file: BinaryIO, offset: int, content: bytes) -> None:
    file.seek(offset)
    file.write(content)


def _points_as_stored(layer: Layer, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a person's points as in the file, and the number of views used, shape (frame, keypoint).

    The points have shape (frame, keypoint, 4), float32: x, y, z in mm, and a number whose high byte has the camera
    bits, the first camera lowest, and whose low byte is the standard deviation in steps of 0.1 mm, or 0 if unknown.
    Filled points have the number 0; missing points are 0, 0, 0, -1.
    """
    used = is_used(np.asarray(layer.view_status)[:, index])
    deviation = 1000.0 * np.sqrt((layer.sd_m[:, index] ** 2).mean(axis=-1))
    steps = np.clip(np.round(np.nan_to_num(deviation, nan=1.0) / _RESIDUAL_STEP_MM), 1, 255)
    n_views = used.shape[-1]
    cameras = (used * 2 ** (8 + np.arange(n_views))).sum(axis=-1) if n_views <= _CAMERA_BITS else 0
    filled = np.asarray(layer.source)[:, index] == Source.FILLED
    words = np.empty((*filled.shape, 4), dtype="<f4")
    words[..., :3] = 1000.0 * np.asarray(layer.points_m)[:, index]
    words[..., 3] = np.where(filled, 0.0, np.where(np.isfinite(deviation), steps, 0.0) + cameras)
    words[~layer.has_point[:, index]] = _MISSING
    return words, used.sum(axis=-1)


def _first_frame(result: Reconstruction) -> int:
    """Return the number of the first frame if the header (16 bits) can hold it and the last one, otherwise 0."""
    first = int(result.frame_numbers[0])
    return first if first + result.n_frames < _FRAMES_OF_HEADER else 0


def _add_list(content: ezc3d.c3d, name: str, values: list[str] | list[float]) -> None:
    """Add a list as NAME, NAME2, ..., because a parameter has at most 255 entries, as LABELS and LABELS2 do."""
    for part, start in enumerate(range(0, len(values), _LONGEST_AXIS), 1):
        content.add_parameter("POSEFUSE", name if part == 1 else f"{name}{part}", values[start : start + _LONGEST_AXIS])


def _add_screen(content: ezc3d.c3d, up: UpAxis | None) -> None:
    if up is None:
        return
    content.add_parameter("POINT", "X_SCREEN", [_SCREEN_X[up]])
    content.add_parameter("POINT", "Y_SCREEN", [up.upper() if up.startswith("-") else f"+{up.upper()}"])


def _add_actual_fields(content: ezc3d.c3d, n_rows: int) -> None:
    for name, frame in (("ACTUAL_START_FIELD", 1), ("ACTUAL_END_FIELD", n_rows)):
        words = [frame % 65536, frame // 65536]
        content.add_parameter("TRIAL", name, [float(word) for word in words])
        parameter = content["parameters"]["TRIAL"][name]
        parameter["type"] = _INTEGER
        parameter["value"] = np.array(words)


FORMAT = ResultFormat(
    name="c3d",
    files="<person>.c3d",
    conventions=(
        "mm, world axes (X_SCREEN, Y_SCREEN state the up axis); missing is residual -1; camera "
        "bits for up to 7 views; files of other programs can be read"
    ),
    lacks="status, reprojection errors, covariances between the axes",
    endings=(".c3d",),
    matches=matches,
    read=read_points,
    write_person=write,
)
