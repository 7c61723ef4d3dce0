"""TRC, the text format of OpenSim: one file per person, y up if the up axis is known; missing points are empty cells.

Layout after OpenSim's documentation, "Marker (.trc) Files". The first line has the layer after the file name. A missing
last cell of a row is written as ``nan``, because OpenSim's table reader ignores an empty cell after the last tab and
then rejects the row.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from posefuse.arrays import ranges
from posefuse.errors import FileError
from posefuse.io.files import read_text, replacing
from posefuse.io.number_rows import number_rows
from posefuse.io.results.axes import y_up_from_world
from posefuse.io.results.format import ResultFormat
from posefuse.io.results.timing import export_rate, regular_rows
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import Source
from posefuse.model.stored_points import StoredPoints
from posefuse.progress import Progress, Silent, report_ranges

_FIRST = "PathFileType"
_DECIMALS = 6
"""Decimals of coordinates in m and of times in s."""


@dataclass(frozen=True)
class TrcContent:
    """The content of a TRC file.

    Attributes:
        names: names of the points as in the file.
        time_s: shape (frame,).
        points_m: shape (frame, point, 3), in the file's axes, NaN where missing.
        rate_hz: frames per second.
        unit: unit of the points: ``m``, to which cm and mm are converted, or ``px``.
    """

    names: tuple[str, ...]
    time_s: np.ndarray
    points_m: np.ndarray
    rate_hz: float
    unit: str = "m"


def write(result: Reconstruction, person: str, path: Path, layer: LayerName, progress: Progress | None = None) -> None:
    """Write one person.

    Raises:
        ResultError: if the frame rate is unknown or not constant.
    """
    rate = export_rate(result, "TRC")
    row_indices, n_rows = regular_rows(result)
    start = float(result.frame_numbers[0]) / rate
    if np.isfinite(result.time_s[0]):
        start = float(result.time_s[0])
    names = [re.sub(r"[\x00-\x1f\x7f-\x9f]", " ", name) for name in result.skeleton.keypoints]
    header = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name} layer={layer}{_filled_text(result, person, layer)}{_up_text(result)}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate:.10g}\t{rate:.10g}\t{n_rows}\t{len(names)}\t{result.unit}\t{rate:.10g}\t1\t{n_rows}",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{i}" for i in range(1, len(names) + 1) for axis in "XYZ"),
        "",
    ]
    turn = y_up_from_world(result.rig.up_axis if result.unit == "m" else None)
    index = result.person_ids.index(person)
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode())
        row = 0
        done = 0
        for part in report_ranges(result.windows(), result.n_frames, f"writing {path.name}", progress or Silent()):
            points = np.asarray(part.layers[layer].points_m[:])[:, index] @ turn.T
            rows = row_indices[done : done + len(points)]
            number = np.arange(row, int(rows[-1]) + 1)
            values = np.full((len(number), 2 + points[0].size), np.nan)
            values[:, 0], values[:, 1] = number + 1, start + number / rate
            values[rows - row, 2:] = points.reshape(len(points), -1)
            file.write(_rows(values))
            done, row = done + len(points), row + len(number)


def _rows(values: np.ndarray) -> bytes:
    """Return rows as text; missing numbers are empty except for the last one."""
    decimals = np.full(values.shape[1], _DECIMALS)
    decimals[0] = 0
    lines = number_rows(values, decimals, "\t")
    return lines.replace(b"\t\n", b"\tnan\n")


def _filled_text(result: Reconstruction, person: str, layer: LayerName) -> str:
    """Return the number of filled points as text, if there are any; the format has no other place for it."""
    source, index = result.layers[layer].source, result.person_ids.index(person)
    spans = ranges(result.n_frames, CHUNK_FRAMES)
    number = sum(int((np.asarray(source[start:stop])[:, index] == Source.FILLED).sum()) for start, stop in spans)
    return f" filled={number}" if number else ""


def _up_text(result: Reconstruction) -> str:
    """Return a text that marks an inferred up axis; empty if it was not inferred."""
    inferred = result.rig.inferred_up is not None and result.rig.up_axis is not None
    return f" world_up={result.rig.up_axis}(inferred)" if inferred else ""


def read(path: Path) -> TrcContent:
    """Read a TRC file of any program.

    Raises:
        FileError: if the file does not conform to the format.
    """
    lines = read_text(path).splitlines()
    if len(lines) < 5 or not lines[0].startswith(_FIRST):
        raise FileError(f"{path} is not a TRC file: it should begin with PathFileType and have five header lines.")
    keys, values = lines[1].split("\t"), lines[2].split("\t")
    header = dict(zip(keys, values, strict=False))
    try:
        rate = float(header["DataRate"])
        unit = header["Units"].strip()
        scale = {"m": 1.0, "cm": 0.01, "mm": 0.001, "px": 1.0}[unit]
    except (KeyError, ValueError):
        raise FileError(f"{path}, lines 2 and 3: expected DataRate and Units (m, cm or mm), got {header}.") from None
    names = tuple(name.strip() for name in lines[3].split("\t")[2:] if name.strip())
    width = 2 + 3 * len(names)
    rows = [(number, line) for number, line in enumerate(lines[5:], 6) if line.strip()]
    n_frames = header.get("NumFrames", "").strip()
    if n_frames.isdigit() and int(n_frames) != len(rows):
        raise FileError(f"{path} has {len(rows)} rows, but its header declares {n_frames} frames. Is it truncated?")
    table = np.full((len(rows), width), np.nan)
    for i, (number, line) in enumerate(rows):
        cells = line.split("\t")[:width]
        try:
            table[i, : len(cells)] = [float(cell) if cell.strip() else np.nan for cell in cells]
        except ValueError:
            raise FileError(f"{path}, line {number}: a cell is neither a number nor empty.") from None
    points = table[:, 2:].reshape(len(rows), len(names), 3) * scale
    return TrcContent(names, table[:, 1], points, rate, "px" if unit == "px" else "m")


def matches(path: Path) -> bool:
    """Return whether a file is in this format."""
    with path.open("rb") as content:
        return content.read(len(_FIRST)) == _FIRST.encode()


def read_points(path: Path) -> StoredPoints:
    """Read the points of a TRC file of any program as one person named after the file, in the file's axes.

    Frames are numbered from 0, because the format numbers only rows.

    Raises:
        FileError: if the file does not conform to the format.
    """
    content = read(path)
    return StoredPoints(
        keypoints=content.names,
        person_ids=(path.stem,),
        frame_numbers=np.arange(len(content.time_s)),
        time_s=content.time_s,
        points_m=content.points_m[:, None],
        unit=content.unit,
        rate_hz=content.rate_hz,
    )


FORMAT = ResultFormat(
    name="trc",
    files="<person>.trc",
    conventions="meters; y up if the up axis is known; missing is an empty cell",
    lacks="status, errors, covariances, views",
    endings=(".trc",),
    matches=matches,
    read=read_points,
    write_person=write,
)
