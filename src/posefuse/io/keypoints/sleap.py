"""SLEAP's analysis files: ``*.h5`` with ``tracks`` (track, 2, node, frame), one a camera, any number of animals.

Files of sleap-io name the axes in an attribute ``dims`` (JSON), and may have them in another order. Pixels; NaN is
missing; ``point_scores`` are the confidences. Views are named by the folders the files are in, or by what differs
between the files' names. The files say no frame rate.
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
from posefuse.io.keypoints.names import skeleton_of, view_names
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton


def matches(path: Path) -> bool:
    """Whether a file is one, or a folder holds some, one level deep."""
    return any(_is_one(file) for file in files_of(path))


def files_of(path: Path) -> list[Path]:
    """The files, in the order of their names; broken ones too, for a camera must not go missing unsaid."""
    if not path.is_dir():
        return [file for file in files_at(path) if file.suffix == ".h5" and _is_one(file) is not False]
    found = [file for pattern in ("*.h5", "*/*.h5") for file in path.glob(pattern) if _is_one(file) is not False]
    return sorted(found, key=lambda file: natural_key(file.relative_to(path).as_posix()))


def _is_one(file: Path) -> bool | None:
    """Whether the file is one; None of a file that cannot be opened."""
    try:
        with h5py.File(file) as content:
            return "tracks" in content and "node_names" in content
    except (OSError, KeyError, ValueError, RuntimeError):
        return None


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: if a file is broken, or the cameras have different nodes.
    """
    files = files_of(path)
    for file in files:
        if _is_one(file) is None:
            raise FileError(
                f"{file} is no HDF5 file that can be read ({file.stat().st_size} bytes). Is the file truncated?"
            )
    skeleton, views = request.skeleton, []
    for file, name in zip(files, view_names(files), strict=True):
        with open_hdf5(file, "analysis file") as content:
            found = _skeleton(content)
            if skeleton is None:
                skeleton = found
            elif len(found) != len(skeleton) or (request.skeleton is None and found != skeleton):
                raise FileError(
                    f"{file} has the nodes {choices(found.keypoints)}, expected {choices(skeleton.keypoints)}: one "
                    "recording has one skeleton."
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
    # A person corrected by hand has a score of 0, or none: the detector says nothing then.
    values[..., 2] = np.where(values[..., 2] > 0.0, values[..., 2], np.nan)
    frame, track = np.nonzero(~missing.all(axis=-1))
    return ViewColumns(
        name=name,
        recorded=np.arange(len(pixels), dtype=np.int64),
        frame_of_row=frame.astype(np.int64),
        keypoints=values[frame, track],
        track_ids=track.astype(np.int64),
    )


def _in_order(data: Any, usual: tuple[str, ...]) -> np.ndarray:
    """Numbers with the axes frame, track, node and xy, those that there are.

    Args:
        data: of the file.
        usual: order of its axes, where the file does not say.
    """
    said = data.attrs.get("dims")
    axes = tuple(json.loads(said)) if said is not None else usual
    values = np.asarray(data, dtype=np.float64)
    return values.transpose([axes.index(axis) for axis in ("frame", "track", "node", "xy") if axis in usual])


FORMAT = KeypointFormat(
    name="sleap",
    files="a folder of analysis *.h5, one per camera, or one folder per camera",
    conventions="px; NaN is missing; cameras by folder or file name; no frame rate: --rate-hz",
    recognized_by="HDF5 with tracks and node_names",
    matches=matches,
    read=read,
    camera_files=files_of,
)
