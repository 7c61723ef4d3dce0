"""posefuse's tidy tables of 2D keypoints, CSV and parquet; ``tidy_columns`` has the columns.

CSV is text that any program reads: names of keypoints are in it, bones are not, and where the names are not those of a
shipped skeleton they make one of their own. Parquet written here also holds the skeleton, the order of the views, the
rate and the notes (as JSON in the schema's metadata, ``posefuse``), and is then read by ranges of frames.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import reading, replacing
from posefuse.io.keypoints import tidy_parquet
from posefuse.io.keypoints.columns import far_apart
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.names import skeleton_named
from posefuse.io.keypoints.parquet_metadata import column_names
from posefuse.io.keypoints.request import Request
from posefuse.io.keypoints.tidy_columns import NEEDED, detections_of_table, table_of
from posefuse.model.detections import Detections


def matches(path: Path) -> bool:
    """Whether the file is one."""
    if not path.is_file():
        return False
    if path.suffix == ".parquet":
        return set(NEEDED) <= set(column_names(path))
    return path.suffix == ".csv" and set(NEEDED) <= set(_header(path))


def _header(path: Path) -> list[str]:
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        return [word.strip().strip('"') for word in lines.readline(10_000).split(",")]


def read(path: Path, request: Request) -> Detections:
    """Read the table; one in parquet that posefuse wrote stays in its file.

    Raises:
        FileError: if the file is cut short, or a column holds something else than it should.
    """
    if path.suffix == ".parquet":
        return tidy_parquet.read(path, request)
    return detections_of_table(path, _read_csv(path), request)


def _read_csv(path: Path) -> Any:
    import pyarrow as pa
    from pyarrow import csv

    # Nothing but an empty cell is missing: a camera may be called NA.
    kinds = {"camera": pa.string(), "keypoint": pa.string()}
    options = csv.ConvertOptions(column_types=kinds, strings_can_be_null=True, null_values=[""])
    parse = csv.ParseOptions(newlines_in_values=True)
    with reading(path, "CSV table of keypoints"):
        table = csv.read_csv(path, parse_options=parse, convert_options=options)
        if len(set(table.column_names)) != len(table.column_names):
            raise FileError(f"{path} has two columns of one name.")
        return table


def write(detections: Detections, path: Path) -> None:
    """Write a table, range by range; the kind by the name's ending, ``.csv`` or ``.parquet``.

    Raises:
        FileError: if the name ends otherwise.
    """
    writers: dict[str, Callable[[Detections, Path], None]] = {".csv": _write_csv, ".parquet": tidy_parquet.write}
    if path.suffix not in writers:
        raise FileError(f"A tidy table's name ends in .csv or .parquet, got {path.name}.")
    with replacing(path) as temporary:
        writers[path.suffix](detections, temporary)


def _write_csv(detections: Detections, path: Path) -> None:
    import pyarrow as pa
    from pyarrow import csv

    kinds = table_of(detections.frames(0, 0)).schema
    plain = pa.schema([(f.name, pa.string() if pa.types.is_dictionary(f.type) else f.type) for f in kinds])
    with path.open("wb") as file, csv.CSVWriter(file, plain) as writer:
        for chunk in detections.chunks():
            writer.write_table(table_of(chunk).cast(plain))


def lost(detections: Detections, path: Path) -> tuple[str, ...]:
    """What of these detections the file cannot hold."""
    if path.suffix == ".parquet":
        return ()
    told = []
    if skeleton_named("tidy", detections.skeleton.keypoints) != detections.skeleton:
        told.append("a skeleton of one's own: its bones, sides and tree")
    if tuple(sorted(detections.view_names)) != detections.view_names:
        told.append("the order of the views: they are read by name")
    silent = detections.n_views - int(np.any(detections.recorded, axis=0).sum())
    if silent:
        told.append("views without any frame")
    if detections.n_frames and far_apart(detections.frame_numbers):
        told.append("frames as far apart as these so that they can be read again: parquet can")
    if detections.notes:
        told.append("what was noted when the detections were read")
    return tuple(told)


FORMAT = KeypointFormat(
    name="tidy",
    files="*.csv or *.parquet with camera, frame, keypoint, x_px, y_px",
    conventions=(
        "px; one row per keypoint; any number of people; times; parquet is lossless and read in ranges of frames"
    ),
    matches=matches,
    read=read,
    write=write,
    lost=lost,
    endings=(".csv", ".parquet"),
)
