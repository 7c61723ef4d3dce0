"""SLEAP analysis files: ``*.h5`` with ``tracks`` (track, 2, node, frame), one per camera, any number of animals.

Files of sleap-io name the axes in an attribute ``dims`` (JSON), possibly in another order. Positions are in pixels; NaN
is missing; ``point_scores`` are the confidences. Views are named by the folders of the files, or by the part in which
the file names differ. The files have no frame rate.
"""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.files import files_at, natural_key
from posefuse.io.hdf5 import open_hdf5
from posefuse.io.keypoints.columns import ViewColumns, assemble
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.names import view_names
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.from_names import skeleton_of
from posefuse.skeleton.skeletons import Skeleton


def matches(path: Path) -> bool:
    """Return whether a path is a file in this format or a folder that contains some, one level deep."""
    return any(_is_one(file) for file in files_of(path))


def files_of(path: Path) -> list[Path]:
    """Return the files in natural order, including broken ones, because a camera must not be dropped silently."""
    if not path.is_dir():
        return [file for file in files_at(path) if file.suffix == ".h5" and _is_one(file) is not False]
    files = [file for pattern in ("*.h5", "*/*.h5") for file in path.glob(pattern) if _is_one(file) is not False]
    return sorted(files, key=lambda file: natural_key(file.relative_to(path).as_posix()))


def _is_one(file: Path) -> bool | None:
    """Return whether a file is in this format, or None if it cannot be opened."""
    try:
        with h5py.File(file) as content:
            return "tracks" in content and "node_names" in content
    except (OSError, KeyError, ValueError, RuntimeError):
        return None


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: If a file is broken, or the cameras have different nodes.
    """
    files = files_of(path)
    for file in files:
        if _is_one(file) is None:
            raise FileError(f"{file} is not a readable HDF5 file ({file.stat().st_size} bytes). Is the file truncated?")
    skeleton, views = request.skeleton, []
    for file, name in zip(files, view_names(files), strict=True):
        with open_hdf5(file, "analysis file") as content:
            file_skeleton = _skeleton(content)
            if skeleton is None:
                skeleton = file_skeleton
            elif len(file_skeleton) != len(skeleton) or (request.skeleton is None and file_skeleton != skeleton):
                raise FileError(
                    f"{file} has the nodes {choices(file_skeleton.keypoints)}, expected "
                    f"{choices(skeleton.keypoints)}. All must have the same skeleton."
                )
            views.append(_view(file, name, content))
    assert skeleton is not None
    return assemble(path, views, skeleton, request.rate_hz)


def _skeleton(content: h5py.File) -> Skeleton:
    nodes = [name.decode() for name in np.asarray(content["node_names"])]
    edges = [(nodes[a], nodes[b]) for a, b in np.asarray(content["edge_inds"])] if "edge_inds" in content else []
    return skeleton_of("sleap", nodes, edges)


def _view(file: Path, name: str, content: h5py.File) -> ViewColumns:
    pixels = _in_order(content["tracks"], ("track", "xy", "node", "frame"))
    if pixels.ndim != 4 or pixels.shape[-1] != 2:
        raise FileError(f"{file}: expected tracks (track, 2, node, frame), got {pixels.shape}.")
    scores = np.full(pixels.shape[:-1], np.nan)
    if "point_scores" in content:
        scores = _in_order(content["point_scores"], ("track", "node", "frame"))
    missing = np.asarray(np.isnan(pixels).any(axis=-1))
    values = np.where(missing[..., None], np.nan, np.concatenate([pixels, scores[..., None]], axis=-1))
    # Manually corrected instances have a score of 0 or none: there is no confidence of the detector.
    values[..., 2] = np.where(values[..., 2] > 0.0, values[..., 2], np.nan)
    frame, track = np.nonzero(~missing.all(axis=-1))
    return ViewColumns(
        name=name,
        recorded=np.arange(len(pixels), dtype=np.int64),
        frame_of_row=frame.astype(np.int64),
        keypoints=values[frame, track],
        track_ids=track.astype(np.int64),
    )


def _in_order(data: Any, default_axes: tuple[str, ...]) -> np.ndarray:
    """Return an array with its axes in the order frame, track, node, xy.

    Args:
        data: Data set of the file.
        default_axes: Order of its axes if the file does not state it.
    """
    dims = data.attrs.get("dims")
    axes = tuple(json.loads(dims)) if dims is not None else default_axes
    values = np.asarray(data, dtype=np.float64)
    return values.transpose([axes.index(axis) for axis in ("frame", "track", "node", "xy") if axis in default_axes])


FORMAT = KeypointFormat(
    name="sleap",
    files="a folder of analysis *.h5, one per camera, or one folder per camera",
    conventions="px; NaN is missing; cameras by folder or file name; no frame rate: `rate_hz`",
    recognized_by="HDF5 with tracks and node_names",
    matches=matches,
    read=read,
    camera_files=files_of,
)
