"""Tidy tables of 2D keypoints in CSV and parquet. ``tidy_columns`` documents the columns.

CSV contains the names of keypoints but no bones; names that are not those of a shipped skeleton make a new one. Parquet
written by posefuse also contains the skeleton, the order of the views, the rate and the notes (as JSON in the metadata
``posefuse`` of the schema), and is read by ranges of frames.
"""

from collections.abc import Callable
from itertools import chain
from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.io.csv_columns import read_csv, write_csv
from posefuse.io.files import replacing
from posefuse.io.keypoints import tidy_parquet
from posefuse.io.keypoints.columns import is_sparse
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.parquet_metadata import column_names
from posefuse.io.keypoints.request import Request
from posefuse.io.keypoints.tidy_columns import (
    COLUMN_KINDS,
    REQUIRED_COLUMNS,
    columns_of_detections,
    detections_of_columns,
)
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
    return detections_of_columns(path, read_csv(path, **COLUMN_KINDS), request)


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
    empty = detections.frames(0, 0)
    write_csv((columns_of_detections(part) for part in chain([empty], detections.chunks())), path)


def lost(detections: Detections, path: Path) -> tuple[str, ...]:
    """Return what of the detections is lost in the file."""
    if path.suffix == ".parquet":
        return ()
    losses = []
    if skeleton_named("tidy", detections.skeleton.keypoints) != detections.skeleton:
        losses.append("the bones, sides and tree of a custom skeleton")
    if not len(detections.keypoints_px):
        losses.append("the skeleton, because there are no people; `skeleton` states it when the file is read")
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
