"""Read and write tables of OpenSim over time: ``.mot`` and ``.sto`` (OpenSim, "Storage files")."""

import math
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.evaluation.angle_agreement import TRANSLATIONS, AngleSeries
from posefuse.io.files import replacing

SUFFIXES = (".mot", ".sto")
_MAX_HEADER_LINES = 200


def is_motion_table(path: Path) -> bool:
    """Return whether a file's name has an ending of OpenSim's tables."""
    return path.suffix.lower() in SUFFIXES


def read_joint_angles(path: Path) -> AngleSeries:
    """Read the joint angles of a ``.mot`` or ``.sto`` file in degrees; translations are left out.

    Columns with a path of OpenSim 4, such as ``/jointset/hip_r/hip_flexion_r/value``, get the name of the coordinate.

    Raises:
        FileError: if the file is not such a table.
    """
    in_degrees, header = _header(path)
    columns, values = _table(path, header)
    if "time" not in columns:
        raise FileError(f"{path} has no column time after endheader. Its columns: {', '.join(columns)[:200]}.")
    names = [_coordinate(column) for column in columns]
    wanted = [c for c, name in enumerate(names) if name and name != "time" and not name.endswith(TRANSLATIONS)]
    if not wanted:
        raise FileError(f"{path} has no joint angles. Its columns: {', '.join(columns)[:200]}.")
    factor = 1.0 if in_degrees else 180.0 / math.pi
    return AngleSeries(
        path.name, values[:, columns.index("time")], tuple(names[c] for c in wanted), factor * values[:, wanted]
    )


def _table(path: Path, header: int) -> tuple[list[str], np.ndarray]:
    """Return the column names and the rows that follow a header."""
    with path.open(encoding="utf-8", errors="replace") as file:
        lines = [line for line in islice(file, header, None) if line.strip()]
    if len(lines) < 2:
        raise FileError(f"{path} has no rows after endheader.")
    columns = lines[0].split()
    try:
        values = np.loadtxt(lines[1:], ndmin=2)
    except ValueError as problem:
        raise FileError(f"{path}: expected numbers in all columns. {problem}") from problem
    if values.shape[1] != len(columns):
        raise FileError(f"{path}: expected {len(columns)} numbers per row, one per column, got {values.shape[1]}.")
    return columns, values


def write_coordinates(
    path: Path, time_s: np.ndarray, names: Sequence[str], values: np.ndarray, remarks: Sequence[str] = ()
) -> None:
    """Write coordinates over time as a ``.mot`` file.

    Args:
        path: the file.
        time_s: shape (frame,).
        names: names of the coordinates.
        values: shape (frame, coordinate), in degrees or m.
        remarks: further lines of the header, such as ``layer=solved``.

    Raises:
        FileError: if the file cannot be written.
    """
    header = [
        "Coordinates", "version=1", f"nRows={len(time_s)}", f"nColumns={len(names) + 1}", "inDegrees=yes", *remarks,
        "endheader", "\t".join(["time", *names]),
    ]  # fmt: skip
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write("\n".join(header) + "\n")
        for second, row in zip(time_s, values, strict=True):
            file.write("\t".join([f"{second:.6f}", *(f"{value:.6f}" for value in row)]) + "\n")


def _header(path: Path) -> tuple[bool, int]:
    """Return whether angles are in degrees, and the number of lines up to and including endheader."""
    in_degrees = False
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.strip().lower().replace(" ", "")
            if text == "endheader":
                return in_degrees, number
            if text.startswith("indegrees="):
                in_degrees = text.endswith("yes")
            if number >= _MAX_HEADER_LINES:
                break
    raise FileError(f"{path} has no line endheader and is no table of OpenSim. Export the motion as .mot or .sto.")


def _coordinate(column: str) -> str:
    """Return the name of a coordinate, or an empty text for speeds and other states."""
    if not column.startswith("/"):
        return column
    parts = column.strip("/").split("/")
    return parts[-2] if len(parts) >= 2 and parts[-1] == "value" else ""
