"""Tidy CSV: a row a frame, person and keypoint. Missing numbers are empty; every number is written in full."""

from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv

from posefuse.io.files import replacing
from posefuse.model.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus, Source

FILE_NAMES: dict[LayerName, str] = {"measured": "keypoints.csv", "solved": "solved.csv", "model": "model.csv"}

_STATUS = np.array([next((s.label for s in PointStatus if s == code), "") for code in range(256)], dtype=object)
_SOURCE = np.array([next((s.label for s in Source if s == code), "") for code in range(256)], dtype=object)


def columns(unit: str) -> tuple[str, ...]:
    """The column names; lengths carry their unit."""
    positions = tuple(f"{axis}_{unit}" for axis in "xyz")
    deviations = tuple(f"sd_{axis}_{unit}" for axis in "xyz")
    return (
        "frame",
        "time_s",
        "person",
        "keypoint",
        *positions,
        *deviations,
        "n_views",
        "reprojection_error_px",
        "status",
        "source",
    )


def write(parts: Iterable[Reconstruction], path: Path, layer: LayerName) -> None:
    """Write one layer of consecutive ranges of frames of one reconstruction, each as it comes."""
    layout = csv.WriteOptions(quoting_style="needed", quoting_header="needed")
    with replacing(path) as temporary, ExitStack() as open_file:
        writer: Any = None  # pyarrow's stubs know no constructor of CSVWriter
        for part in parts:
            table = _table(part, layer)
            if writer is None:
                writer = csv.CSVWriter(temporary, table.schema, write_options=layout)
                open_file.callback(writer.close)
            writer.write_table(table)


def _table(part: Reconstruction, name: LayerName) -> pa.Table:
    layer = part.layers[name]
    points = np.asarray(layer.points_m[:])
    frames, people, keypoints, _ = points.shape
    per_frame = people * keypoints
    points = points.reshape(-1, 3)
    deviations = layer.sd_m.reshape(-1, 3)

    def number(values: np.ndarray) -> pa.Array:
        return pa.array(np.asarray(values, dtype=np.float64).ravel(), from_pandas=True)

    def text(values: np.ndarray) -> pa.Array:
        return pa.array(values.ravel(), pa.string())

    names = np.array(part.skeleton.keypoints, dtype=object)
    ids = np.array(part.person_ids, dtype=object)
    data = [
        pa.array(np.repeat(part.frame_numbers, per_frame)),
        number(np.repeat(part.time_s, per_frame)),
        text(np.tile(np.repeat(ids, keypoints), frames)),
        text(np.tile(names, frames * people)),
        *(number(points[:, axis]) for axis in range(3)),
        *(number(deviations[:, axis]) for axis in range(3)),
        pa.array(layer.n_views.ravel()),
        number(np.asarray(layer.reprojection_error_px[:])),
        text(_STATUS[np.asarray(layer.status[:])]),
        text(_SOURCE[np.asarray(layer.source[:])]),
    ]
    return pa.table(data, names=list(columns(part.unit)))
