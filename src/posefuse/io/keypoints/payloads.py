"""Records sent by pose detectors, one per camera and time: payloads of ParaJumping and cvmmap, stored as JSON.

The files are ``*.jsonl`` with one record per line, or ``*.json`` lists of records, for all cameras or, in a folder, for
one each. The specification defines the content (COCO-WholeBody-133 by camera and timestamp) but not the field names.
The first existing name is used, in the record or in its ``payload``:

* camera: ``camera``, ``camera_name``, ``camera_id``, ``label``, ``source``, ``name``; otherwise the name of the file;
* time: ``timestamp_ns``, ``timestamp_us``, ``timestamp_ms``, ``time_s``, ``timestamp`` (unit inferred from its size);
* frame: ``frame_index``, ``frame``, ``frame_count``, ``frame_id``; otherwise frames are assigned by time;
* people: ``detections``, ``people``, ``persons``, ``instances``, ``poses``, a list of objects with ``keypoints``
  (``kps``): rows of ``[x, y]`` or ``[x, y, confidence]`` or one flat list of the latter, ``scores`` (``kps_scores``,
  ``keypoint_scores``) and ``track_id`` (``id``); or ``kps`` and ``kps_scores`` in the record, with one row per person.

Records without people are kept as frames without people. Files are read by ranges of frames (see ``lines``); a
``*.json`` list is held in memory while it is indexed.
"""

from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import natural_key
from posefuse.io.keypoints.camera_files import FileKind, all_camera_files
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.lines import (
    CellColumns,
    Record,
    RecordingInfo,
    check_numbers,
    detections_of_records,
    index_of,
)
from posefuse.io.keypoints.people import Person, beginning, checked_integer, decode, joined, rows_of, without_missing
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections

_CAMERA = ("camera", "camera_name", "camera_id", "label", "source", "name")
_FRAME = ("frame_index", "frame", "frame_count", "frame_id")
_TIMES = {"timestamp_ns": 1e-9, "timestamp_us": 1e-6, "timestamp_ms": 1e-3, "time_s": 1.0, "timestamp": None}
_PEOPLE = ("detections", "people", "persons", "instances", "poses")
_KEYPOINTS = ("keypoints", "kps")
_SCORES = ("scores", "kps_scores", "keypoint_scores")
_TRACK = ("track_id", "id", "track")
_CHANNELS = 3
_NO_FRAME = -(2**60)
_UNITS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))
"""Smallest values of times since 1970 in ns, us and ms. Smaller values are seconds."""


def matches(path: Path) -> bool:
    """Return whether a path is a file in this format or a folder that contains some."""
    return bool(files_of(path))


def files_of(path: Path) -> list[Path]:
    """Return the files, including damaged ones, because a camera must not be dropped silently."""
    return [file for file in all_camera_files(path, _KIND) if path.is_file() or file.parent in (path, path.parent)]


def _is_one(file: Path) -> bool:
    if file.suffix not in (".jsonl", ".json") or not file.is_file():
        return False
    start = beginning(file, 20_000)
    has_time = any(f'"{name}":'.encode() in start for name in _TIMES)
    has_people = any(f'"{name}":['.encode() in start for name in (*_PEOPLE, "kps"))
    others = (b'"replay"', b'"cameras"', b'"instance_info"', b'"image_id"', b'"landmarks"')
    return has_time and has_people and start[:1] in (b"{", b"[") and not any(other in start for other in others)


_KIND = FileKind((".jsonl", ".json"), _is_one)


def read(path: Path, request: Request) -> Detections:
    """Index all records. Their numbers stay in the files and are read on demand.

    Raises:
        FileError: If a record is incomplete or lacks a required field.
        SkeletonError: If the number of keypoints does not identify a skeleton.
        DetectionsError: If a number is impossible.
    """
    files = files_of(path)
    index = _RecordIndex()
    request.progress.start("reading keypoints", len(files))
    for i, file in enumerate(files):
        for record, content, where in _records(file, i):
            _add_record(index, file, record, content, where)
        request.progress.advance(1)
    request.progress.finish()
    if not index.time_ns:
        raise FileError(f"{path} contains no records.")
    names = sorted(index.names, key=natural_key)
    views = np.array([names.index(name) for name in index.names], dtype=np.int64)
    camera = views[np.array(index.cells.camera, dtype=np.int64)]
    frames, seconds = _assign_frames(path, index, camera)
    cells = replace(index.cells, camera=array("q", camera), frame=array("q", frames), time_s=array("d", seconds))
    ordered = index_of(path, files, names, cells, index.n_keypoints)
    info = RecordingInfo(request.skeleton, request.rate_hz)
    return detections_of_records(path, ordered, _people_of, _CHANNELS, info)


@dataclass
class _RecordIndex:
    """Index of the records, collected one after another.

    Attributes:
        names: Names of the cameras, in order of first occurrence.
        cells: One cell per record, whose camera is an index into ``names``; ``_NO_FRAME`` without a frame number.
        time_ns: Time of each record, or None without one.
        n_keypoints: Number of keypoints per person, 0 without people.
    """

    names: list[str] = field(default_factory=list)
    cells: CellColumns = field(default_factory=CellColumns)
    time_ns: list[int | None] = field(default_factory=list)
    n_keypoints: int = 0


def _records(file: Path, number: int) -> Iterator[tuple[Record, Mapping[str, Any], str]]:
    """Yield the position, content and description of each record of a file."""
    if not file.stat().st_size:
        raise FileError(f"{file} is empty. Is the file truncated?")
    if file.suffix == ".json":
        content, at = file.read_bytes(), 0
        for i, raw in enumerate(decode(file, list[msgspec.Raw])):
            at = content.index(raw, at)
            where = f"{file}, record {i}"
            yield Record(number, at, len(raw)), _content(bytes(raw), where), where
            at += len(raw)
        return
    at = 0
    with file.open("rb") as lines:
        for i, line in enumerate(lines, start=1):
            start, at = at, at + len(line)
            if line.strip():
                where = f"{file}, line {i}"
                yield Record(number, start, len(line)), _content(line, where), where


def _content(record: bytes, where: str) -> Mapping[str, Any]:
    try:
        row = msgspec.json.decode(record, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(f"{where} is not a complete record: {error}. Is the file truncated?") from None
    return {**row, **row["payload"]} if isinstance(row.get("payload"), dict) else row


def _add_record(index: _RecordIndex, file: Path, record: Record, row: Mapping[str, Any], where: str) -> None:
    """Add the cell of a record to the index."""
    name, frame, time_ns = _camera(row, file), _first(row, _FRAME), _time_ns(row, where)
    if frame is not None:
        checked_integer(frame, "the frame", where)
    elif time_ns is None:
        raise FileError(f"{where} has neither a frame ({', '.join(_FRAME)}) nor a time ({', '.join(_TIMES)}).")
    people, tracks = _detected_people(row, where)
    if len(people):
        index.n_keypoints = index.n_keypoints or people.shape[1]
        if people.shape[1] != index.n_keypoints:
            raise FileError(
                f"{where}: a person has {people.shape[1]} keypoints, but others have {index.n_keypoints}. All must "
                "have the same skeleton. Is the file truncated?"
            )
    if name not in index.names:
        index.names.append(name)
    index.time_ns.append(time_ns)
    index.cells.add(record, _NO_FRAME if frame is None else frame, index.names.index(name), np.nan, tracks)


def _people_of(record: bytes, file: Path, where: str) -> dict[str, np.ndarray]:
    """Return the people of the camera of a record, shape (person, keypoint, 3): x, y, confidence."""
    row = _content(record, where)
    return {_camera(row, file): _detected_people(row, where)[0]}


def _camera(row: Mapping[str, Any], file: Path) -> str:
    camera = _first(row, _CAMERA)
    return file.stem if camera is None else str(camera)


def _detected_people(row: Mapping[str, Any], where: str) -> tuple[np.ndarray, list[int]]:
    """Return the people with a detected keypoint, shape (person, keypoint, 3), and their track ids."""
    people = _people(row, where)
    rows = [rows_of(person, where) for person in people]
    lengths = sorted({len(each) for each in rows})
    if len(lengths) > 1:
        raise FileError(
            f"{where}: people have {lengths} keypoints. All must have the same skeleton. Is the file truncated?"
        )
    keypoints = without_missing(np.array(rows).reshape(len(rows), lengths[0] if lengths else 0, _CHANNELS))
    check_numbers(keypoints, where)
    valid = np.asarray(np.isfinite(keypoints[..., 0]).any(axis=1))
    return keypoints[valid], [person.track for person, is_valid in zip(people, valid.tolist(), strict=True) if is_valid]


def _first(row: Mapping[str, Any], names: Sequence[str]) -> Any:
    return next((row[name] for name in names if row.get(name) is not None), None)


def _time_ns(row: Mapping[str, Any], where: str) -> int | None:
    name = next((name for name in _TIMES if row.get(name) is not None), None)
    if name is None:
        return None
    value = row[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e20:
        raise FileError(f"{where}: expected a number for {name}, got {str(value)[:40]!r}.")
    unit = _TIMES[name] or next((unit for least, unit in _UNITS if abs(value) > least), 1.0)
    # Integers stay integers: nanoseconds since 1970 exceed the precision of float64.
    return value * round(unit * 1e9) if isinstance(value, int) else round(value * unit * 1e9)


def _people(row: Mapping[str, Any], where: str) -> list[Person]:
    people = _first(row, _PEOPLE)
    if people is None and "kps" in row:
        points, scores = row["kps"], row.get("kps_scores")
        lengths_fit = isinstance(points, list) and (
            scores is None or (isinstance(scores, list) and len(scores) == len(points))
        )
        if not lengths_fit:
            raise FileError(f"{where}: kps and kps_scores must be lists of equal length with one row per person.")
        people = [{"keypoints": p, "scores": None if scores is None else scores[i]} for i, p in enumerate(points)]
    if not isinstance(people, list) or not all(isinstance(person, dict) for person in people):
        raise FileError(f"{where}: expected a list of people ({', '.join(_PEOPLE)}).")
    return [_person(person, where) for person in people]


def _person(person: Mapping[str, Any], where: str) -> Person:
    points, scores, track = _first(person, _KEYPOINTS), _first(person, _SCORES), _first(person, _TRACK)
    if not isinstance(points, list):
        raise FileError(f"{where}: a person has no keypoints ({', '.join(_KEYPOINTS)}).")
    values: Any = points
    if scores is not None:
        values = joined(points, scores, where, 0)
    elif any(point is None or (isinstance(point, list) and len(point) == 2) for point in points):
        values = [_x_y_confidence(point) for point in points]
    number = track if isinstance(track, int) and not isinstance(track, bool) and abs(track) < 2**40 else -1
    return Person(0, values, number)


def _x_y_confidence(point: Any) -> Any:
    """Return a keypoint with NaN for what it lacks: all if null, as in the lines of a stream, or the confidence."""
    if point is None:
        return [np.nan] * _CHANNELS
    return [*point, np.nan] if isinstance(point, list) and len(point) == 2 else point


def _assign_frames(path: Path, index: _RecordIndex, camera: np.ndarray) -> tuple[list[int], list[float]]:
    """Return the frame number and the time from the first, s, of each record.

    If a record has no frame number, all are assigned to frames by time.
    """
    stamps = [time_ns for time_ns in index.time_ns if time_ns is not None]
    start = min(stamps, default=0)
    seconds = [np.nan if time_ns is None else (time_ns - start) * 1e-9 for time_ns in index.time_ns]
    if _NO_FRAME not in index.cells.frame:
        return list(index.cells.frame), seconds
    if len(stamps) < len(seconds):
        raise FileError(f"{path}: some records lack a time and others lack a frame, so they cannot be matched.")
    times = np.array(seconds)
    period = _period_s(times, camera)
    frames, last = [0] * len(seconds), dict[int, int]()
    for i in np.argsort(times, kind="stable").tolist():
        view = int(camera[i])
        # Jitter of a clock must not give a camera two records for one frame.
        frames[i] = max(round(seconds[i] / period), last.get(view, -1) + 1)
        last[view] = frames[i]
    return frames, seconds


def _period_s(seconds: np.ndarray, camera: np.ndarray) -> float:
    """Return the median interval between the records of a camera, in s."""
    steps = np.concatenate([np.diff(np.sort(seconds[camera == view])) for view in np.unique(camera)])
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else 1.0


FORMAT = KeypointFormat(
    name="payloads",
    files="*.jsonl or *.json of records, one per camera and time (ParaJumping, cvmmap, lines of posefuse stream)",
    conventions="px; x y confidence; the number of keypoints selects the skeleton; frames by number or by time",
    matches=matches,
    read=read,
    camera_files=files_of,
)
