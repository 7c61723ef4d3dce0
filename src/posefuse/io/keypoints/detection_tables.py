"""Parquet detection folders with one row per camera and frame, as in the specification of the articulated tracker.

The files are ``<camera>.parquet`` or ``<camera>/*.parquet`` in a folder, or one file with a column ``camera``. The
first existing name of each column is used:

* ``frame_index`` (``frame``, ``frame_id``): number of the frame;
* ``kps`` (``keypoints``): list of people, each a list of keypoints ``[x, y]`` or ``[x, y, confidence]``, px;
* ``kps_scores`` (``scores``, ``keypoint_scores``): list of people, each a list of confidences;
* ``time_s`` or ``timestamp_ns``: time of the frame; optional;
* ``track_ids``: list of integers, one per person, -1 without one; optional;
* ``sigma_px``, ``depth``: like ``kps_scores``; optional.

Rows without people are kept as frames without people. Files are read by ranges of frames: memory holds one row group
and about 30 bytes per person, frame and view. Keypoints at (0, 0) with confidence 0 are missing, as detectors write
them; files written by posefuse use NaN.
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
from posefuse.io.arrow import import_pyarrow
from posefuse.io.files import checked_file_name, natural_key, reading, replacing_folder
from posefuse.io.keypoints.columns import common_frames, rate_of_frames
from posefuse.io.keypoints.detection_rows import Index, NumberRows, PeopleIndex, TrackRows, index_files, reordered
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.infer_skeleton import infer_skeleton, no_skeleton, wrong_skeleton
from posefuse.io.keypoints.parquet_metadata import RecordingMetadata, column_names, metadata_of, read_metadata
from posefuse.io.keypoints.request import Request, apply_request
from posefuse.lazy_array import as_array
from posefuse.model.detections import Detections, frame_times
from posefuse.skeleton.skeletons import Skeleton

_COLUMN_NAMES = {
    "frame": ("frame_index", "frame", "frame_id"),
    "kps": ("kps", "keypoints"),
    "scores": ("kps_scores", "scores", "keypoint_scores"),
    "time": ("time_s", "timestamp_ns"),
    "camera": ("camera", "camera_name", "port"),
    "track": ("track_ids",),
    "sigma": ("sigma_px",),
    "depth": ("depth",),
}
_INFERENCE_PEOPLE = 500
_GROUP_FRAMES = 512
"""Frames per row group: small, so that overlapping ranges read little twice."""


def matches(path: Path) -> bool:
    """Return whether a path is a table in this format or a folder with one per camera."""
    return bool(_cameras(path))


def _cameras(path: Path) -> dict[str, list[Path]]:
    """Return the files of each camera. One file with all cameras has the name ""."""
    if path.is_file():
        if not _is_table(path):
            return {}
        return {"" if set(_COLUMN_NAMES["camera"]) & set(column_names(path)) else path.stem: [path]}
    for pattern in ("*.parquet", "*/*.parquet"):
        files = sorted(path.glob(pattern), key=lambda file: natural_key(file.relative_to(path).as_posix()))
        if not any(_is_table(file) for file in files):
            continue
        cameras: dict[str, list[Path]] = {}
        for file in files:
            # Broken files are included: their cameras must not be dropped silently.
            if _is_table(file) or not column_names(file):
                cameras.setdefault(file.stem if file.parent == path else file.parent.name, []).append(file)
        # A single subfolder is a recording itself, whose files are cameras.
        return cameras if len(cameras) > 1 or pattern == "*.parquet" else {}
    return {}


def _is_table(file: Path) -> bool:
    if file.suffix != ".parquet" or not file.is_file():
        return False
    columns = set(column_names(file))
    return bool(columns & set(_COLUMN_NAMES["frame"])) and bool(columns & set(_COLUMN_NAMES["kps"]))


def read(path: Path, request: Request) -> Detections:
    """Open the tables. Long arrays stay in the files and are read on demand.

    Raises:
        FileError: If a file is truncated, or a row is invalid.
        SkeletonError: If the number of keypoints does not identify a skeleton.
    """
    pq = import_pyarrow().parquet
    cameras = _cameras(path)
    files = [file for several in cameras.values() for file in several]
    if not files:
        raise FileError(f"{path} contains no table of detections with columns such as frame_index, kps and kps_scores.")
    columns = _columns_of(files)
    with reading(path, "folder of detection tables"):
        recording = read_metadata(files[0], pq.read_schema(files[0]).metadata)
        names, index = index_files(files, [name for name, several in cameras.items() for _ in several], columns)
        if recording is not None and set(names) <= set(recording.views):
            index = reordered(index, np.array([recording.views.index(name) for name in names]))
            names = recording.views
        detections = _detections(path, names, index, columns, request, recording)
    return detections if recording is None else apply_request(detections, request, path)


def _columns_of(files: Sequence[Path]) -> dict[str, str]:
    """Return the names of the columns, which must be the same in all files."""
    existing = set(column_names(files[0]))
    for file in files[1:]:
        if set(column_names(file)) != existing:
            raise FileError(
                f"{file} has the columns {choices(column_names(file))}, but {files[0].name} has "
                f"{choices(sorted(existing))}. Is the file truncated?"
            )
    named = {kind: next((name for name in names if name in existing), None) for kind, names in _COLUMN_NAMES.items()}
    return {kind: name for kind, name in named.items() if name is not None}


def _detections(
    path: Path,
    names: Sequence[str],
    index: Index,
    columns: dict[str, str],
    request: Request,
    recording: RecordingMetadata | None,
) -> Detections:
    if not len(index.frame):
        raise FileError(f"{path} is an empty recording: its tables have no rows.")
    numbers = common_frames(path, index.frame, own=recording is not None)
    cells = np.searchsorted(numbers, index.frame), index.view
    shape = len(numbers), len(names)
    recorded, people = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=np.int64)
    recorded[cells], people[cells] = True, index.people
    rate = (request.rate_hz if recording is None else recording.rate_hz) or None
    times = np.where(recorded, frame_times(numbers, len(names), rate), np.nan)
    if index.time_s is not None:
        times[cells] = index.time_s
        rate = rate or rate_of_frames(times)
    skeleton, notes = _skeleton(path, index.places, columns, request, recording)
    places = replace(index.places, n_keypoints=len(skeleton))

    def numbers_of(kind: str) -> np.ndarray | None:
        return as_array(NumberRows(places, columns[kind])) if kind in columns else None

    confidence = numbers_of("scores")

    return Detections(
        skeleton=skeleton,
        view_names=tuple(names),
        frame_numbers=numbers,
        time_s=times,
        offsets=np.concatenate([[0], np.cumsum(people)]),
        keypoints_px=as_array(NumberRows(places, columns["kps"], (0, 1), zero_is_missing=recording is None)),
        confidence=as_array(NumberRows(places, columns["kps"], (2,))) if confidence is None else confidence,
        recorded=recorded,
        track_ids=as_array(TrackRows(places, columns.get("track"))),
        depth=numbers_of("depth"),
        sigma_px=numbers_of("sigma"),
        rate_hz=rate,
        notes=notes,
    )


def _skeleton(
    path: Path, index: PeopleIndex, columns: dict[str, str], request: Request, recording: RecordingMetadata | None
) -> tuple[Skeleton, tuple[str, ...]]:
    skeleton, notes = request.skeleton, ()
    if recording is not None:
        skeleton, notes = recording.skeleton, recording.notes
    elif skeleton is None and index.n_keypoints:
        sample = NumberRows(index, columns["kps"], (0, 1), zero_is_missing=True)[:_INFERENCE_PEOPLE]
        skeleton, notes = infer_skeleton(index.n_keypoints, sample, str(path))
    if skeleton is None:
        raise no_skeleton(path)
    if index.n_keypoints and len(skeleton) != index.n_keypoints:
        raise wrong_skeleton(path, index.n_keypoints, skeleton)
    return skeleton, notes


def write(detections: Detections, path: Path) -> None:
    """Write a folder with one table per camera, one range of frames after another.

    Raises:
        FileError: If the folder contains other files, or the name of a view is not a valid file name.
    """
    write_pieces(detections.chunks() if detections.n_frames else [detections], path)


def write_pieces(pieces: Iterable[Detections], path: Path) -> None:
    """Write consecutive ranges of frames to a folder as they arrive.

    Args:
        pieces: At least one range. Everything that does not depend on the frame is taken from the first.
        path: Folder. It appears when all ranges are written.

    Raises:
        FileError: If the folder contains other files, or the name of a view is not a valid file name.
    """
    pq = import_pyarrow().parquet
    pieces = iter(pieces)
    first = next(pieces)
    files = [f"{checked_file_name(name)}.parquet" for name in first.view_names]
    metadata = metadata_of(first)
    with replacing_folder(path, marker=files[0], owned=("*.parquet",)) as staging, contextlib.ExitStack() as opened:
        schemas = [_table(first.frames(0, 0), v).replace_schema_metadata(metadata).schema for v in range(len(files))]
        writers = [
            opened.enter_context(pq.ParquetWriter(staging / file, schema, compression="zstd"))
            for file, schema in zip(files, schemas, strict=True)
        ]
        for piece in itertools.chain([first], pieces):
            for v, writer in enumerate(writers):
                for start, stop in ranges(piece.n_frames, _GROUP_FRAMES):
                    writer.write_table(_table(piece.frames(start, stop), v).replace_schema_metadata(metadata))


def _table(detections: Detections, view: int) -> Any:
    """Return the rows of one view, one per recorded frame."""
    pa = import_pyarrow()
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
    """Return what of the detections is lost in the folder: nothing."""
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
