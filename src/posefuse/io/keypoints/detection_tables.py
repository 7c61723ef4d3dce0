"""Parquet detection folders, as the articulated tracker's specification keeps replays: a row a camera and frame.

A folder of ``<camera>.parquet``, or of ``<camera>/*.parquet``; or one file with a column ``camera``. Columns, of which
the first name that is there counts:

* ``frame_index`` (``frame``, ``frame_id``): number of the frame;
* ``kps`` (``keypoints``): list of people, each a list of keypoints ``[x, y]`` or ``[x, y, confidence]``; px;
* ``kps_scores`` (``scores``, ``keypoint_scores``): list of people, each a list of confidences;
* ``time_s``, or ``timestamp_ns``: when the camera took it; optional;
* ``track_ids``: list of whole numbers, one a person, -1 for none; optional;
* ``sigma_px``, ``depth``: as ``kps_scores``; optional.

Rows without people are frames without people, and stay. Files are read by ranges of frames: of a recording of any
length a row group is in memory, and some 30 bytes for each person in each frame of each view. Keypoints with a
confidence of 0 at 0, 0 are missing, as detectors write them; files that posefuse wrote say NaN.
"""

import contextlib
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.arrays import ranges
from posefuse.errors import FileError, choices
from posefuse.io.files import checked_file_name, natural_key, reading, replacing_folder
from posefuse.io.keypoints.columns import line_of_frames, rate_of_frames
from posefuse.io.keypoints.detection_rows import Index, NumberRows, TrackRows, index_files, reordered
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.infer_skeleton import guess_skeleton
from posefuse.io.keypoints.parquet_metadata import About, about_of, column_names, metadata_of
from posefuse.io.keypoints.request import Request, asked_of
from posefuse.model.detections import Detections, frame_times
from posefuse.skeleton.skeletons import Skeleton

_NAMES = {
    "frame": ("frame_index", "frame", "frame_id"),
    "kps": ("kps", "keypoints"),
    "scores": ("kps_scores", "scores", "keypoint_scores"),
    "time": ("time_s", "timestamp_ns"),
    "camera": ("camera", "camera_name", "port"),
    "track": ("track_ids",),
    "sigma": ("sigma_px",),
    "depth": ("depth",),
}
_JUDGED = 500
_GROUP_FRAMES = 512
"""Small enough that ranges which overlap do not read much twice."""


def matches(path: Path) -> bool:
    """Whether a file is one, or a folder holds one a camera."""
    return bool(_cameras(path))


def _cameras(path: Path) -> dict[str, list[Path]]:
    """The files of each camera; of one file with all cameras, that file by no name."""
    if path.is_file():
        if not _is_one(path):
            return {}
        return {"" if set(_NAMES["camera"]) & set(column_names(path)) else path.stem: [path]}
    for pattern in ("*.parquet", "*/*.parquet"):
        files = sorted(path.glob(pattern), key=lambda file: natural_key(file.relative_to(path).as_posix()))
        if not any(_is_one(file) for file in files):
            continue
        found: dict[str, list[Path]] = {}
        for file in files:
            # One that cannot be opened is there too: a camera must not go missing unsaid.
            if _is_one(file) or not column_names(file):
                found.setdefault(file.stem if file.parent == path else file.parent.name, []).append(file)
        # One folder alone is a recording of its own, whose files are cameras.
        return found if len(found) > 1 or pattern == "*.parquet" else {}
    return {}


def _is_one(file: Path) -> bool:
    if file.suffix != ".parquet" or not file.is_file():
        return False
    columns = set(column_names(file))
    return bool(columns & set(_NAMES["frame"])) and bool(columns & set(_NAMES["kps"]))


def read(path: Path, request: Request) -> Detections:
    """Open the tables; what is long stays in them.

    Raises:
        FileError: if a file is cut short, or a row is not what the format says.
        SkeletonError: if the number of keypoints does not tell the skeleton.
    """
    import pyarrow.parquet as pq

    cameras = _cameras(path)
    files = [file for several in cameras.values() for file in several]
    if not files:
        raise FileError(f"{path} holds no table of detections: columns such as frame_index, kps and kps_scores.")
    columns = _columns_of(files)
    with reading(path, "folder of detection tables"):
        about = about_of(files[0], pq.read_schema(files[0]).metadata)
        names, index = index_files(files, [name for name, several in cameras.items() for _ in several], columns)
        if about is not None and set(names) <= set(about.views):
            index = reordered(index, np.array([about.views.index(name) for name in names]))
            names = about.views
        detections = _detections(path, names, index, columns, request, about)
    return detections if about is None else asked_of(detections, request, path)


def _columns_of(files: Sequence[Path]) -> dict[str, str]:
    """What the columns are called, in all files alike."""
    there = set(column_names(files[0]))
    for file in files[1:]:
        if set(column_names(file)) != there:
            raise FileError(
                f"{file} has the columns {choices(column_names(file))}, {files[0].name} has {choices(sorted(there))}. "
                "Is the file truncated?"
            )
    named = {kind: next((name for name in names if name in there), None) for kind, names in _NAMES.items()}
    return {kind: name for kind, name in named.items() if name is not None}


def _detections(
    path: Path,
    names: Sequence[str],
    index: Index,
    columns: dict[str, str],
    request: Request,
    about: About | None,
) -> Detections:
    if not len(index.frame):
        raise FileError(f"{path} is an empty recording: its tables have no rows.")
    numbers = line_of_frames(path, index.frame, own=about is not None)
    cells = np.searchsorted(numbers, index.frame), index.view
    shape = len(numbers), len(names)
    recorded, people = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=np.int64)
    recorded[cells], people[cells] = True, index.people
    rate = (request.rate_hz if about is None else about.rate_hz) or None
    times = np.where(recorded, frame_times(numbers, len(names), rate), np.nan)
    if index.time_s is not None:
        times[cells] = index.time_s
        rate = rate or rate_of_frames(times)
    skeleton, notes = _skeleton(path, index, columns, request, about)
    index = replace(index, n_keypoints=len(skeleton))

    def numbers_of(kind: str) -> NumberRows | None:
        return NumberRows(index, columns[kind]) if kind in columns else None

    return Detections(
        skeleton=skeleton,
        view_names=tuple(names),
        frame_numbers=numbers,
        time_s=times,
        offsets=np.concatenate([[0], np.cumsum(people)]),
        keypoints_px=NumberRows(index, columns["kps"], (0, 1), blank=about is None),
        confidence=numbers_of("scores") or NumberRows(index, columns["kps"], (2,)),
        recorded=recorded,
        track_ids=TrackRows(index, columns.get("track")),
        depth=numbers_of("depth"),
        sigma_px=numbers_of("sigma"),
        rate_hz=rate,
        notes=notes,
    )


def _skeleton(
    path: Path, index: Index, columns: dict[str, str], request: Request, about: About | None
) -> tuple[Skeleton, tuple[str, ...]]:
    found, notes = request.skeleton, ()
    if about is not None:
        found, notes = about.skeleton, about.notes
    elif found is None and index.n_keypoints:
        some = NumberRows(index, columns["kps"], (0, 1), blank=True)[:_JUDGED]
        found, notes = guess_skeleton(index.n_keypoints, some, str(path))
    if found is None:
        raise FileError(f"{path}: nobody was detected in any view, so nothing tells the skeleton. Add --skeleton.")
    if index.n_keypoints and len(found) != index.n_keypoints:
        raise FileError(
            f"{path} has {index.n_keypoints} keypoints a person, skeleton {found.name} has {len(found)}. Choose "
            "another with --skeleton, or leave it out to have it told from the files."
        )
    return found, notes


def write(detections: Detections, path: Path) -> None:
    """Write a folder of a table a camera, range by range.

    Raises:
        FileError: if the folder holds other files, or a view's name cannot be a file's.
    """
    write_pieces(detections.chunks() if detections.n_frames else [detections], path)


def write_pieces(pieces: Iterable[Detections], path: Path) -> None:
    """The same of consecutive ranges of frames, each as it comes.

    Args:
        pieces: at least one; what does not depend on the frame is taken from the first.
        path: the folder; it appears when all are in it.

    Raises:
        FileError: if the folder holds other files, or a view's name cannot be a file's.
    """
    import pyarrow.parquet as pq

    pieces = iter(pieces)
    first = next(pieces)
    files = [f"{checked_file_name(name)}.parquet" for name in first.view_names]
    told = metadata_of(first)
    with replacing_folder(path, marker=files[0], owned=("*.parquet",)) as staging, contextlib.ExitStack() as opened:
        schemas = [_table(first.frames(0, 0), v).replace_schema_metadata(told).schema for v in range(len(files))]
        writers = [
            opened.enter_context(pq.ParquetWriter(staging / file, schema, compression="zstd"))
            for file, schema in zip(files, schemas, strict=True)
        ]
        for piece in itertools.chain([first], pieces):
            for v, writer in enumerate(writers):
                for start, stop in ranges(piece.n_frames, _GROUP_FRAMES):
                    writer.write_table(_table(piece.frames(start, stop), v).replace_schema_metadata(told))


def _table(detections: Detections, view: int) -> Any:
    """The rows of one view: of every frame that it recorded."""
    import pyarrow as pa

    recorded = detections.recorded[:, view]
    people = detections.people_counts[recorded, view]
    starts = detections.offsets[:-1].reshape(detections.n_frames, detections.n_views)[recorded, view]
    rows = np.repeat(starts - (np.cumsum(people) - people), people) + np.arange(int(people.sum()))
    ends = pa.array(np.concatenate([[0], np.cumsum(people)]).astype(np.int32))

    def nested(values: Any) -> Any:
        numbers = np.asarray(values)[rows]
        inner = pa.array(numbers.ravel())
        for length in reversed(numbers.shape[1:]):
            count = len(inner) // length
            inner = pa.ListArray.from_arrays(pa.array(np.arange(count + 1, dtype=np.int32) * length), inner)
        return pa.ListArray.from_arrays(ends, inner)

    columns = {
        "frame_index": pa.array(detections.frame_numbers[recorded]),
        "time_s": pa.array(detections.time_s[recorded, view]),
        "kps": nested(detections.keypoints_px),
        "kps_scores": nested(detections.confidence),
        "track_ids": nested(detections.track_ids),
    }
    for name in ("sigma_px", "depth"):
        if getattr(detections, name) is not None:
            columns[name] = nested(getattr(detections, name))
    return pa.table(columns)


def lost(detections: Detections, path: Path) -> tuple[str, ...]:
    """What of these detections the folder cannot hold: nothing."""
    return ()


FORMAT = KeypointFormat(
    name="detection_tables",
    files="a folder of *.parquet, one per camera, with frame_index, kps, kps_scores",
    conventions="px; one row per camera and frame; frames without people are kept; read in ranges of frames",
    matches=matches,
    read=read,
    write=write,
    lost=lost,
)
