"""SLEAP's projects and predictions, ``*.slp``, read with sleap-io (``pip install posefuse[sleap]``).

One file of all cameras, whose videos are the views, or a file a camera in a folder, or in folders in it. Instances are
people, single animal or many; tracks are their identities, numbered as the file lists them. Predicted points have their
scores as confidence; points put by hand have none. Of an instance made by hand and the prediction that it corrects the
former counts. Videos are not opened.
"""

import math
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from posefuse.errors import FileError, PosefuseError, choices
from posefuse.io.files import reading
from posefuse.io.hdf5 import check_hdf5
from posefuse.io.keypoints.camera_files import FileKind, all_camera_files
from posefuse.io.keypoints.columns import ViewColumns, assemble
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.names import skeleton_named, skeleton_of, view_names
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton

_MOST_FRAMES = 10_000_000
_SIGNATURE = b"\x89HDF\r\n\x1a\n"


def matches(path: Path) -> bool:
    """Whether a file is one, or a folder holds some."""
    return bool(files_of(path))


def files_of(path: Path) -> list[Path]:
    """The projects, damaged ones too: a camera must not go missing unsaid."""
    return all_camera_files(path, _KIND)


def _is_one(file: Path) -> bool:
    """Whether it is called as a project and begins as HDF5 does."""
    if file.suffix != ".slp" or not file.is_file():
        return False
    with file.open("rb") as content:
        return content.read(len(_SIGNATURE)) == _SIGNATURE


_KIND = FileKind((".slp",), _is_one)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: if a file is broken, views have different nodes, or sleap-io is not installed.
    """
    files, views, nodes = files_of(path), [], None
    request.progress.start("reading keypoints", len(files))
    for file, name in zip(files, view_names(files), strict=True):
        check_hdf5(file, "SLEAP file")
        with reading(file, "SLEAP file"):
            labels = _load(file)
            found = _skeleton(labels)
            if nodes is not None and found.keypoints != nodes.keypoints:
                raise FileError(
                    f"{file} has the nodes {choices(found.keypoints)}, expected {choices(nodes.keypoints)}: one "
                    "recording has one skeleton."
                )
            nodes = nodes or found
            views += _views(file, labels, name, len(found), several=len(files) > 1)
        request.progress.advance(1)
    request.progress.finish()
    assert nodes is not None
    skeleton = request.skeleton or nodes
    if len(skeleton) != len(nodes):
        raise FileError(f"{path} has {len(nodes)} nodes, skeleton {skeleton.name} has {len(skeleton)} keypoints.")
    return assemble(path, views, skeleton, request.rate_hz)


def _load(file: Path) -> Any:
    try:
        from sleap_io.io.main import load_slp
    except ImportError:
        raise FileError(f"{file} is a SLEAP file, which sleap-io reads: pip install posefuse[sleap]") from None
    try:
        return load_slp(str(file), open_videos=False)
    except PosefuseError:
        raise
    except Exception as error:  # a broken file raises whatever its bytes lead to
        said = " ".join(str(error).split())[:160] or type(error).__name__
        raise FileError(f"{file} is not a SLEAP file that can be read: {said}. Is the file truncated?") from None


def _skeleton(labels: Any) -> Skeleton:
    if len(labels.skeletons) != 1:
        raise FileError(f"It has {len(labels.skeletons)} skeletons; one recording has one.")
    (found,) = labels.skeletons
    nodes = [str(node.name) for node in found.nodes]
    edges = [(str(edge.source.name), str(edge.destination.name)) for edge in found.edges]
    named = skeleton_named("sleap", nodes)
    return named if named.name != "sleap" else skeleton_of("sleap", nodes, edges)


def _views(file: Path, labels: Any, name: str, n_nodes: int, *, several: bool) -> list[ViewColumns]:
    """The views of a file: its videos; where there is one alone, it is called as the file is among others."""
    videos = list(labels.videos)
    names = [name]
    if len(videos) > 1:
        if several:
            raise FileError(f"{file} is of {len(videos)} videos, and lies beside other files. Give one: --keypoints.")
        names = _video_names(videos)
    places = {id(track): i for i, track in enumerate(labels.tracks)}
    return [
        _view(view, [frame for frame in labels.labeled_frames if frame.video is video], video, places, n_nodes)
        for view, video in zip(names, videos, strict=True)
    ]


def _video_names(videos: Sequence[Any]) -> list[str]:
    paths = []
    for video in videos:
        given = video.filename[0] if isinstance(video.filename, list) else video.filename
        paths.append(PurePosixPath(str(given).replace("\\", "/")))
    stems = [path.stem for path in paths]
    if len(set(stems)) < len(stems):
        stems = [path.parent.name for path in paths]
    if len(set(stems)) < len(stems):
        raise FileError(f"Videos of the same name: {choices(stems)}. Views need names that differ.")
    return stems


def _view(name: str, frames: Sequence[Any], video: Any, places: dict[int, int], n_nodes: int) -> ViewColumns:
    rows: list[tuple[int, int, np.ndarray]] = []
    for frame in frames:
        rows += [(int(frame.frame_idx), *person) for person in _people(frame, places, n_nodes)]
    rows.sort(key=lambda row: row[0])
    known = np.array([int(frame.frame_idx) for frame in frames], dtype=np.int64)
    last, shape = int(known.max(initial=-1)), getattr(video, "shape", None)
    # A video has all its frames; of one whose length nobody knows, those up to the last that is labelled.
    length = int(shape[0]) if shape is not None and not math.isnan(shape[0] or math.nan) else last + 1
    recorded = known if max(length, last) > 4 * len(known) + _MOST_FRAMES else np.arange(max(length, last + 1))
    return ViewColumns(
        name=name,
        recorded=recorded,
        frame_of_row=np.array([row[0] for row in rows], dtype=np.int64),
        keypoints=np.array([row[2] for row in rows], dtype=np.float64).reshape(len(rows), n_nodes, 3),
        track_ids=np.array([row[1] for row in rows], dtype=np.int64),
    )


def _people(frame: Any, places: dict[int, int], n_nodes: int) -> list[tuple[int, np.ndarray]]:
    """Track and x, y, confidence of everybody in a frame; who was corrected by hand is there once."""
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
            people.append((places.get(id(instance.track), -1), values))
    return people


FORMAT = KeypointFormat(
    name="slp",
    files="*.slp, one for all cameras or one per camera",
    conventions="px; views are videos, tracks are identities; no frame rate: --rate-hz; needs posefuse[sleap]",
    matches=matches,
    read=read,
    camera_files=files_of,
)
