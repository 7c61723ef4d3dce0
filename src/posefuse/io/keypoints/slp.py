"""SLEAP projects and predictions, ``*.slp``, read with sleap-io (``pip install posefuse[sleap]``).

The input is one file for all cameras, whose videos are the views, or one file per camera in a folder or its subfolders.
Instances are people or animals; tracks are their identities, numbered in the order of the file. Scores of predicted
points are the confidence; manual points have none. A manual instance replaces the prediction that it corrects. Videos
are not opened.

Files written in the browser (luc3d) may lack the attribute ``format_id`` of the group ``metadata``, which numbers the
layout and which sleap-io requires. They are read as the newest layout.
"""

import math
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import h5py
import numpy as np

from posefuse.errors import FileError, PosefuseError, choices
from posefuse.io.files import reading
from posefuse.io.hdf5 import check_hdf5
from posefuse.io.keypoints.camera_files import FileKind, all_camera_files
from posefuse.io.keypoints.columns import ViewColumns, assemble
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.names import view_names
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.from_names import skeleton_named, skeleton_of
from posefuse.skeleton.skeletons import Skeleton

_MAX_MISSING_FRAMES = 10_000_000
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_NEWEST_LAYOUT = 2.8
"""Number of the layout of files that do not state it: that of the columns ``session_data``."""


def matches(path: Path) -> bool:
    """Return whether a path is a file in this format or a folder that contains some."""
    return bool(files_of(path))


def files_of(path: Path) -> list[Path]:
    """Return the files, including damaged ones, because a camera must not be dropped silently."""
    return all_camera_files(path, _KIND)


def _is_one(file: Path) -> bool:
    """Return whether a file has the suffix ``.slp`` and the signature of HDF5."""
    if file.suffix != ".slp" or not file.is_file():
        return False
    with file.open("rb") as content:
        return content.read(len(_SIGNATURE)) == _SIGNATURE


_KIND = FileKind((".slp",), _is_one)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: If a file is broken, views have different nodes, or sleap-io is not installed.
    """
    files, views, nodes = files_of(path), [], None
    unnumbered: list[str] = []
    request.progress.start("reading keypoints", len(files))
    for file, name in zip(files, view_names(files), strict=True):
        check_hdf5(file, "SLEAP file")
        with reading(file, "SLEAP file"), _numbered(file) as readable:
            if readable != file:
                unnumbered.append(file.name)
            labels = _load(readable, file)
            file_nodes = _skeleton(labels)
            if nodes is not None and file_nodes.keypoints != nodes.keypoints:
                raise FileError(
                    f"{file} has the nodes {choices(file_nodes.keypoints)}, expected {choices(nodes.keypoints)}. All "
                    "must have the same skeleton."
                )
            nodes = nodes or file_nodes
            views += _views(file, labels, name, len(file_nodes), several=len(files) > 1)
        request.progress.advance(1)
    request.progress.finish()
    assert nodes is not None
    skeleton = request.skeleton or nodes
    if len(skeleton) != len(nodes):
        raise FileError(f"{path} has {len(nodes)} nodes, but skeleton {skeleton.name} has {len(skeleton)} keypoints.")
    detections = assemble(path, views, skeleton, request.rate_hz)
    if not unnumbered:
        return detections
    note = f"{choices(unnumbered)}: the number of the layout (format_id) is missing; read as the newest layout."
    return replace(detections, notes=(*detections.notes, note))


@contextmanager
def _numbered(file: Path) -> Iterator[Path]:
    """Yield the file, or, if it lacks the number of its layout, a temporary file with the number that links to it."""
    with h5py.File(file, "r") as content:
        metadata = content.get("metadata")
        if not isinstance(metadata, h5py.Group) or "format_id" in metadata.attrs:
            numbered = None
        else:
            numbered = dict(metadata.attrs) | {"format_id": _NEWEST_LAYOUT}
        others = [name for name in content if name != "metadata"]
        inside = list(metadata) if numbered is not None and isinstance(metadata, h5py.Group) else []
    if numbered is None:
        yield file
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / file.name
        # Older versions of HDF5 limit an attribute to 64 KB.
        with h5py.File(copy, "w", libver="latest") as content:
            for name in others:
                content[name] = h5py.ExternalLink(str(file.resolve()), f"/{name}")
            group = content.create_group("metadata")
            for name in inside:
                group[name] = h5py.ExternalLink(str(file.resolve()), f"/metadata/{name}")
            for name, value in numbered.items():
                group.attrs[name] = value
        yield copy


def _load(readable: Path, file: Path) -> Any:
    """Return the labels of a readable file, which may stand for another."""
    try:
        from sleap_io.io.main import load_slp
    except ImportError:
        raise FileError(f"{file} is a SLEAP file. Reading it requires sleap-io: pip install posefuse[sleap]") from None
    try:
        return load_slp(str(readable), open_videos=False)
    except PosefuseError:
        raise
    except Exception as error:  # a broken file can raise any exception
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise FileError(f"{file} is not a readable SLEAP file: {reason}. Is the file truncated?") from None


def _skeleton(labels: Any) -> Skeleton:
    if len(labels.skeletons) != 1:
        raise FileError(f"The file has {len(labels.skeletons)} skeletons; it must have one.")
    (stored,) = labels.skeletons
    nodes = [str(node.name) for node in stored.nodes]
    edges = [(str(edge.source.name), str(edge.destination.name)) for edge in stored.edges]
    named = skeleton_named("sleap", nodes)
    return named if named.name != "sleap" else skeleton_of("sleap", nodes, edges)


def _views(file: Path, labels: Any, name: str, n_nodes: int, *, several: bool) -> list[ViewColumns]:
    """Return the views of a file: its videos. A single video is named after the file."""
    videos = list(labels.videos)
    names = [name]
    if len(videos) > 1:
        if several:
            raise FileError(
                f"{file} has {len(videos)} videos, but its folder contains other files. Choose one file with "
                "`keypoints`."
            )
        names = _video_names(videos)
    track_numbers = {id(track): i for i, track in enumerate(labels.tracks)}
    return [
        _view(view, [frame for frame in labels.labeled_frames if frame.video is video], video, track_numbers, n_nodes)
        for view, video in zip(names, videos, strict=True)
    ]


def _video_names(videos: Sequence[Any]) -> list[str]:
    paths = []
    for video in videos:
        file_name = video.filename[0] if isinstance(video.filename, list) else video.filename
        paths.append(PurePosixPath(str(file_name).replace("\\", "/")))
    stems = [path.stem for path in paths]
    if len(set(stems)) < len(stems):
        stems = [path.parent.name for path in paths]
    if len(set(stems)) < len(stems):
        raise FileError(f"Several videos have the same name: {choices(stems)}. Views need unique names.")
    return stems


def _view(name: str, frames: Sequence[Any], video: Any, track_numbers: dict[int, int], n_nodes: int) -> ViewColumns:
    rows: list[tuple[int, int, np.ndarray]] = []
    for frame in frames:
        rows += [(int(frame.frame_idx), *person) for person in _people(frame, track_numbers, n_nodes)]
    rows.sort(key=lambda row: row[0])
    labeled = np.array([int(frame.frame_idx) for frame in frames], dtype=np.int64)
    last, shape = int(labeled.max(initial=-1)), getattr(video, "shape", None)
    # All frames of a video were recorded; if its length is unknown, those up to the last labeled one.
    length = int(shape[0]) if shape is not None and not math.isnan(shape[0] or math.nan) else last + 1
    is_sparse = max(length, last) > 4 * len(labeled) + _MAX_MISSING_FRAMES
    recorded = labeled if is_sparse else np.arange(max(length, last + 1))
    return ViewColumns(
        name=name,
        recorded=recorded,
        frame_of_row=np.array([row[0] for row in rows], dtype=np.int64),
        keypoints=np.array([row[2] for row in rows], dtype=np.float64).reshape(len(rows), n_nodes, 3),
        track_ids=np.array([row[1] for row in rows], dtype=np.int64),
    )


def _people(frame: Any, track_numbers: dict[int, int], n_nodes: int) -> list[tuple[int, np.ndarray]]:
    """Return track and keypoints (x, y, confidence) of each person in a frame, without corrected predictions."""
    corrected = {id(instance.from_predicted) for instance in frame.instances if instance.from_predicted is not None}
    people = []
    for instance in frame.instances:
        if id(instance) in corrected:
            continue
        points = instance.points
        values = np.full((n_nodes, 3), np.nan)
        values[:, :2] = points["xy"]
        names = points.dtype.names or ()
        if "score" in names:
            values[:, 2] = points["score"]
        values[~np.asarray(points["visible"], dtype=bool) | np.isnan(values[:, :2]).any(axis=1)] = np.nan
        if np.isfinite(values[:, 0]).any():
            people.append((track_numbers.get(id(instance.track), -1), values))
    return people


FORMAT = KeypointFormat(
    name="slp",
    files="*.slp, one for all cameras or one per camera",
    conventions="px; views are videos, tracks are identities; no frame rate: `rate_hz`; needs posefuse[sleap]",
    matches=matches,
    read=read,
    camera_files=files_of,
)
