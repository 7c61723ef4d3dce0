"""Tidy tables of 2D keypoints in CSV and parquet. ``tidy_columns`` documents the columns.

CSV contains the names of keypoints but no bones; names that are not those of a shipped skeleton make a new one. Parquet
written by posefuse also contains the skeleton, the order of the views, the rate and the notes (as JSON in the metadata
``posefuse`` of the schema), and is read by ranges of frames.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import reading, replacing
from posefuse.io.keypoints import tidy_parquet
from posefuse.io.keypoints.columns import is_sparse
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.parquet_metadata import column_names
from posefuse.io.keypoints.request import Request
from posefuse.io.keypoints.tidy_columns import REQUIRED_COLUMNS, detections_of_table, table_of
from posefuse.model.detections import Detections
from posefuse.skeleton.from_names import skeleton_named


def matches(path: Path) -> bool:
    """Return whether a file is in this format."""
    if not path.is_file():
        return False
    if path.suffix == ".parquet":
        return set(REQUIRED_COLUMNS) <= set(column_names(path))
    return path.suffix == ".csv" and set(REQUIRED_COLUMNS) <= set(_header(path))


def _header(path: Path) -> list[str]:
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        return [word.strip().strip('"') for word in lines.readline(10_000).split(",")]


def read(path: Path, request: Request) -> Detections:
    """Read a table. The arrays of parquet files written by posefuse stay in the file and are read on demand.

    Raises:
        FileError: If the file is truncated, or a column has invalid content.
    """
    if path.suffix == ".parquet":
        return tidy_parquet.read(path, request)
    return detections_of_table(path, _read_csv(path), request)


def _read_csv(path: Path) -> Any:
    import pyarrow as pa
    from pyarrow import csv

    # Only empty cells are missing: a camera may be called NA.
    kinds = {"camera": pa.string(), "keypoint": pa.string()}
    options = csv.ConvertOptions(column_types=kinds, strings_can_be_null=True, null_values=[""])
    parse = csv.ParseOptions(newlines_in_values=True)
    with reading(path, "CSV table of keypoints"):
        table = csv.read_csv(path, parse_options=parse, convert_options=options)
        if len(set(table.column_names)) != len(table.column_names):
            raise FileError(f"{path} has two columns with the same name.")
        return table


def write(detections: Detections, path: Path) -> None:
    """Write a table, one range of frames after another. The name must end in ``.csv`` or ``.parquet``.

    Raises:
        FileError: If the name has another ending, or the file cannot be written.
    """
    writers: dict[str, Callable[[Detections, Path], None]] = {".csv": _write_csv, ".parquet": tidy_parquet.write}
    if path.suffix not in writers:
        raise FileError(f"The name of a tidy table must end in .csv or .parquet, got {path.name}.")
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
    """Return what of the detections is lost in the file."""
    if path.suffix == ".parquet":
        return ()
    losses = []
    if skeleton_named("tidy", detections.skeleton.keypoints) != detections.skeleton:
        losses.append("the bones, sides and tree of a custom skeleton")
    if tuple(sorted(detections.view_names)) != detections.view_names:
        losses.append("the order of the views, which are sorted by name when read")
    without_frames = detections.n_views - int(np.any(detections.recorded, axis=0).sum())
    if without_frames:
        losses.append("views without any frame")
    if detections.n_frames and is_sparse(detections.frame_numbers):
        losses.append("frame numbers with such large gaps, which are not read again; parquet keeps them")
    if detections.notes:
        losses.append("the notes of the detections")
    return tuple(losses)


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
