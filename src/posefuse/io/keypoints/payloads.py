"""Records as pose detectors send them, a camera and time each: ParaJumping's and cvmmap's payloads, stored as JSON.

A ``*.jsonl`` of a record a line, or a ``*.json`` list of records, of all cameras or, in a folder, of one each. The
specification says what they hold (COCO-WholeBody-133 by camera and timestamp), not what the fields are called; of these
names the first that is there counts, in the record or in its ``payload``:

* the camera: ``camera``, ``camera_name``, ``camera_id``, ``label``, ``source``, ``name``; else the name of the file;
* the time: ``timestamp_ns``, ``timestamp_us``, ``timestamp_ms``, ``time_s``, ``timestamp`` (whose size tells its unit);
* the frame: ``frame_index``, ``frame``, ``frame_count``, ``frame_id``; without one frames are told by time;
* the people: ``detections``, ``people``, ``persons``, ``instances``, ``poses``, a list of objects with ``keypoints``
  (``kps``): rows of ``[x, y]`` or ``[x, y, confidence]`` or one flat list of the latter, ``scores`` (``kps_scores``,
  ``keypoint_scores``) and ``track_id`` (``id``); or ``kps`` and ``kps_scores``, lists of a row a person, in the record.

Records without people are frames without people, and stay. Files are read by ranges of frames, see ``lines``; of a
``*.json`` list all its bytes are in memory while it is looked through.
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
    Cells,
    Record,
    Told,
    detections_of_lines,
    index_of,
    must_be_possible,
)
from posefuse.io.keypoints.people import Person, beginning, decode, joined, rows_of, whole, without_missing
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
"""Clocks since 1970 are so large in ns, in us, in ms; what is smaller is seconds."""


def matches(path: Path) -> bool:
    """Whether a file is one, or a folder holds some."""
    return bool(files_of(path))


def files_of(path: Path) -> list[Path]:
    """The files, damaged ones too: a camera must not go missing unsaid."""
    return [file for file in all_camera_files(path, _KIND) if path.is_file() or file.parent in (path, path.parent)]


def _is_one(file: Path) -> bool:
    if file.suffix not in (".jsonl", ".json") or not file.is_file():
        return False
    start = beginning(file, 20_000)
    said = any(f'"{name}":'.encode() in start for name in _TIMES)
    there = any(f'"{name}":['.encode() in start for name in (*_PEOPLE, "kps"))
    others = (b'"replay"', b'"cameras"', b'"instance_info"', b'"image_id"', b'"landmarks"')
    return said and there and start[:1] in (b"{", b"[") and not any(other in start for other in others)


_KIND = FileKind((".jsonl", ".json"), _is_one)


def read(path: Path, request: Request) -> Detections:
    """Look through all records; their numbers stay in the files.

    Raises:
        FileError: if a record is not whole, or lacks what the format says.
        SkeletonError: if the number of keypoints does not tell the skeleton.
        DetectionsError: if a number cannot be.
    """
    files = files_of(path)
    found = _Found()
    request.progress.start("reading keypoints", len(files))
    for i, file in enumerate(files):
        for record, content, where in _records(file, i):
            _note(found, file, record, content, where)
        request.progress.advance(1)
    request.progress.finish()
    if not found.time_ns:
        raise FileError(f"{path} holds no record.")
    names = sorted(found.names, key=natural_key)
    places = np.array([names.index(name) for name in found.names], dtype=np.int64)
    camera = places[np.array(found.cells.camera, dtype=np.int64)]
    frames, seconds = _settle_frames(path, found, camera)
    cells = replace(found.cells, camera=array("q", camera), frame=array("q", frames), time_s=array("d", seconds))
    index = index_of(path, files, names, cells, found.n_keypoints)
    return detections_of_lines(path, index, _people_of, _CHANNELS, Told(request.skeleton, request.rate_hz))


@dataclass
class _Found:
    """What a look through the records finds, one after another.

    Attributes:
        names: of the cameras, in the order in which they come.
        cells: a record each, whose cameras are places in ``names``; ``_NO_FRAME`` where none is said.
        time_ns: of each record; None where none is said.
        n_keypoints: of each person; 0 where there is nobody.
    """

    names: list[str] = field(default_factory=list)
    cells: Cells = field(default_factory=Cells)
    time_ns: list[int | None] = field(default_factory=list)
    n_keypoints: int = 0


def _records(file: Path, number: int) -> Iterator[tuple[Record, Mapping[str, Any], str]]:
    """The records of a file, one after another, each with where it is."""
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
        raise FileError(f"{where} is no whole record: {error}. Is the file truncated?") from None
    return {**row, **row["payload"]} if isinstance(row.get("payload"), dict) else row


def _note(found: _Found, file: Path, record: Record, row: Mapping[str, Any], where: str) -> None:
    """Note who is in a record."""
    name, frame, time_ns = _camera(row, file), _first(row, _FRAME), _time_ns(row, where)
    if frame is not None:
        whole(frame, "the frame", where)
    elif time_ns is None:
        raise FileError(f"{where}: neither a frame ({', '.join(_FRAME)}) nor a time ({', '.join(_TIMES)}).")
    people, tracks = _seen(row, where)
    if len(people):
        found.n_keypoints = found.n_keypoints or people.shape[1]
        if people.shape[1] != found.n_keypoints:
            raise FileError(
                f"{where}: a person has {people.shape[1]} keypoints, others have {found.n_keypoints}; one recording "
                "has one skeleton. Was the file cut short?"
            )
    if name not in found.names:
        found.names.append(name)
    found.time_ns.append(time_ns)
    found.cells.add(record, _NO_FRAME if frame is None else frame, found.names.index(name), np.nan, tracks)


def _people_of(record: bytes, file: Path, where: str) -> dict[str, np.ndarray]:
    """Of a record's camera shape (person, keypoint, 3): x, y, confidence."""
    row = _content(record, where)
    return {_camera(row, file): _seen(row, where)[0]}


def _camera(row: Mapping[str, Any], file: Path) -> str:
    camera = _first(row, _CAMERA)
    return file.stem if camera is None else str(camera)


def _seen(row: Mapping[str, Any], where: str) -> tuple[np.ndarray, list[int]]:
    """Those of whom a keypoint was seen, shape (person, keypoint, 3), and their tracks."""
    people = _people(row, where)
    rows = [rows_of(person, where) for person in people]
    lengths = sorted({len(each) for each in rows})
    if len(lengths) > 1:
        raise FileError(
            f"{where}: people have {lengths} keypoints; one recording has one skeleton. Was the file cut short?"
        )
    keypoints = without_missing(np.array(rows).reshape(len(rows), lengths[0] if lengths else 0, _CHANNELS))
    must_be_possible(keypoints, where)
    seen = np.asarray(np.isfinite(keypoints[..., 0]).any(axis=1))
    return keypoints[seen], [person.track for person, there in zip(people, seen.tolist(), strict=True) if there]


def _first(row: Mapping[str, Any], names: Sequence[str]) -> Any:
    return next((row[name] for name in names if row.get(name) is not None), None)


def _time_ns(row: Mapping[str, Any], where: str) -> int | None:
    name = next((name for name in _TIMES if row.get(name) is not None), None)
    if name is None:
        return None
    value = row[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e20:
        raise FileError(f"{where}: {name} should be a number, got {str(value)[:40]!r}.")
    unit = _TIMES[name] or next((unit for least, unit in _UNITS if abs(value) > least), 1.0)
    # Whole numbers stay whole: a clock's nanoseconds are more than a float holds.
    return value * round(unit * 1e9) if isinstance(value, int) else round(value * unit * 1e9)


def _people(row: Mapping[str, Any], where: str) -> list[Person]:
    people = _first(row, _PEOPLE)
    if people is None and "kps" in row:
        points, scores = row["kps"], row.get("kps_scores")
        lengths_fit = isinstance(points, list) and (
            scores is None or (isinstance(scores, list) and len(scores) == len(points))
        )
        if not lengths_fit:
            raise FileError(f"{where}: kps and kps_scores are lists of a row a person, one as long as the other.")
        people = [{"keypoints": p, "scores": None if scores is None else scores[i]} for i, p in enumerate(points)]
    if not isinstance(people, list) or not all(isinstance(person, dict) for person in people):
        raise FileError(f"{where}: no list of people ({', '.join(_PEOPLE)}).")
    return [_person(person, where) for person in people]


def _person(person: Mapping[str, Any], where: str) -> Person:
    points, scores, track = _first(person, _KEYPOINTS), _first(person, _SCORES), _first(person, _TRACK)
    if not isinstance(points, list):
        raise FileError(f"{where}: a person without keypoints ({', '.join(_KEYPOINTS)}).")
    values: Any = points
    if scores is not None:
        values = joined(points, scores, where, 0)
    elif points and isinstance(points[0], list) and len(points[0]) == 2:
        values = joined(points, [1.0] * len(points), where, 0)
        values[:, 2] = np.nan
    number = track if isinstance(track, int) and not isinstance(track, bool) and abs(track) < 2**40 else -1
    return Person(0, values, number)


def _settle_frames(path: Path, found: _Found, camera: np.ndarray) -> tuple[list[int], list[float]]:
    """The frame of each record, and its time from the first, s: by number where all have one, else by time."""
    known = [time_ns for time_ns in found.time_ns if time_ns is not None]
    start = min(known, default=0)
    seconds = [np.nan if time_ns is None else (time_ns - start) * 1e-9 for time_ns in found.time_ns]
    if _NO_FRAME not in found.cells.frame:
        return list(found.cells.frame), seconds
    if len(known) < len(seconds):
        raise FileError(f"{path}: some records say no time and some no frame; nothing tells which belong together.")
    times = np.array(seconds)
    period = _period_s(times, camera)
    frames, last = [0] * len(seconds), dict[int, int]()
    for i in np.argsort(times, kind="stable").tolist():
        view = int(camera[i])
        # A camera whose clock jitters has no two frames at once.
        frames[i] = max(round(seconds[i] / period), last.get(view, -1) + 1)
        last[view] = frames[i]
    return frames, seconds


def _period_s(seconds: np.ndarray, camera: np.ndarray) -> float:
    """The median interval of cameras' records."""
    steps = np.concatenate([np.diff(np.sort(seconds[camera == view])) for view in np.unique(camera)])
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else 1.0


FORMAT = KeypointFormat(
    name="payloads",
    files="*.jsonl or *.json of records, one per camera and time (ParaJumping, cvmmap)",
    conventions="px; x y confidence; the number of keypoints selects the skeleton; frames by number or by time",
    matches=matches,
    read=read,
    camera_files=files_of,
)
