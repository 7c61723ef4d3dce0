"""SLEAP's 3D points, ``points3d.h5`` as sleap-anipose writes it: ``tracks`` (frame, track, node, 3), NaN where missing.

Lengths are in meters. The names of tracks and nodes and all other fields are in the group ``posefuse``, see
:mod:`posefuse.io.results.hdf5`; in the root, other programs would take the file for one of 2D predictions. Missing
frame numbers are rows without points.
"""

from pathlib import Path

import h5py
import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import must_exist, replacing
from posefuse.io.hdf5 import open_hdf5
from posefuse.io.results import hdf5
from posefuse.io.results.format import ResultFacts, ResultFormat
from posefuse.io.results.rows import blocks, rows_of
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.stored_points import StoredPoints


def write(result: Reconstruction, path: Path, layer: LayerName) -> None:
    """Write one layer of all people.

    Raises:
        ResultError: if there are no frames, or nearly all rows would be empty.
    """
    row_indices, n_rows = rows_of(result, "sleap")
    points = result.layers[layer].points_m
    with replacing(path) as temporary, h5py.File(temporary, "w") as file:
        shape = (n_rows, *points.shape[1:])
        layout = {"chunks": True, "compression": "gzip", "compression_opts": 1} if all(shape) else {}
        tracks = file.create_dataset("tracks", shape, np.float64, **layout)  # type: ignore[arg-type]
        tracks.attrs["Description"] = "Shape: (n_frames, n_tracks, n_nodes, 3)."
        row = 0
        for block in blocks(points, row_indices):
            tracks[row : row + len(block)] = block
            row += len(block)
        hdf5.write_group(file, result, layer)


def matches(path: Path) -> bool:
    """Return whether a file is in this format."""
    try:
        with h5py.File(path) as file:
            tracks = file.get("tracks")
            return isinstance(tracks, h5py.Dataset) and tracks.ndim == 4 and tracks.shape[-1] == 3
    except (OSError, KeyError, ValueError, RuntimeError):
        return False


def read(path: Path) -> StoredPoints:
    """Read a file of sleap-anipose or posefuse; without names, nodes are ``node_0`` and tracks ``track_0``.

    Raises:
        FileError: if it is not such a file, or corrupt.
    """
    must_exist(path, "file of 3D points of SLEAP")
    with open_hdf5(path, "HDF5 file of 3D points") as file:
        points = np.asarray(file["tracks"], dtype=np.float64)
        if points.ndim != 4 or points.shape[-1] != 3:
            raise FileError(f"{path}: expected tracks (frame, track, node, 3), got {points.shape}.")
        if hdf5.GROUP in file:
            return hdf5.read_group(file, path, points)
        return StoredPoints(
            keypoints=tuple(f"node_{i}" for i in range(points.shape[2])),
            person_ids=tuple(f"track_{i}" for i in range(points.shape[1])),
            frame_numbers=np.arange(len(points)),
            time_s=np.full(len(points), np.nan),
            points_m=points,
        )


def _require(facts: ResultFacts) -> None:
    rows_of(facts, "sleap")


FORMAT = ResultFormat(
    name="sleap",
    files="points3d.h5",
    conventions=(
        "meters, world axes; tracks (frame, track, node, 3); one row per frame; names and all other fields in a group"
    ),
    require=_require,
    additional_name="points3d.h5",
    endings=(".h5",),
    name_words=("points3d", "sleap"),
    matches=matches,
    read=read,
    write_layer=write,
)
