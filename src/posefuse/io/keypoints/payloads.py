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

Records without people are frames without people, and stay.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import natural_key
from posefuse.io.keypoints.camera_files import FileKind, all_camera_files
from posefuse.io.keypoints.columns import ViewColumns
from posefuse.io.keypoints.people import Person, beginning, decode, detections_of, joined, view_columns, whole
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections

_CAMERA = ("camera", "camera_name", "camera_id", "label", "source", "name")
_FRAME = ("frame_index", "frame", "frame_count", "frame_id")
_TIMES = {"timestamp_ns": 1e-9, "timestamp_us": 1e-6, "timestamp_ms": 1e-3, "time_s": 1.0, "timestamp": None}
_PEOPLE = ("detections", "people", "persons", "instances", "poses")
_KEYPOINTS = ("keypoints", "kps")
_SCORES = ("scores", "kps_scores", "keypoint_scores")
_TRACK = ("track_id", "id", "track")
_UNITS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))
"""Clocks since 1970 are so large in ns, in us, in ms; what is smaller is seconds."""


@dataclass(frozen=True)
class _Record:
    camera: str
    frame: int | None
    time_ns: int | None
    people: list[Person]


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
    """Read all records.

    Raises:
        FileError: if a record is not whole, or lacks what the format says.
        SkeletonError: if the number of keypoints does not tell the skeleton.
    """
    records: list[_Record] = []
    files = files_of(path)
    request.progress.start("reading keypoints", len(files))
    for file in files:
        records += [_record(content, where, file.stem) for where, content in _contents(file)]
        request.progress.advance(1)
    request.progress.finish()
    if not records:
        raise FileError(f"{path} holds no record.")
    cameras = sorted({record.camera for record in records}, key=natural_key)
    frames, seconds = _settle_frames(path, records)
    views = [_view(path, camera, records, frames, seconds) for camera in cameras]
    return detections_of(path, views, request)


def _contents(file: Path) -> list[tuple[str, Mapping[str, Any]]]:
    """The records of a file, each with where it is."""
    if file.suffix == ".json":
        rows = [(f"{file}, record {i}", row) for i, row in enumerate(decode(file, list[dict[str, Any]]))]
    else:
        rows = []
        if not file.stat().st_size:
            raise FileError(f"{file} is empty. Was it cut short?")
        for number, line in enumerate(file.read_bytes().splitlines(), start=1):
            if not line.strip():
                continue
            try:
                rows.append((f"{file}, line {number}", msgspec.json.decode(line, type=dict[str, Any])))
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
                raise FileError(f"{file}, line {number} is no whole record: {error}. Was it cut short?") from None
    return [(where, {**row, **row["payload"]} if isinstance(row.get("payload"), dict) else row) for where, row in rows]


def _first(row: Mapping[str, Any], names: Sequence[str]) -> Any:
    return next((row[name] for name in names if row.get(name) is not None), None)


def _record(row: Mapping[str, Any], where: str, file: str) -> _Record:
    camera = _first(row, _CAMERA)
    frame = _first(row, _FRAME)
    if frame is not None:
        whole(frame, "the frame", where)
    time_ns = _time_ns(row, where)
    if frame is None and time_ns is None:
        raise FileError(f"{where}: neither a frame ({', '.join(_FRAME)}) nor a time ({', '.join(_TIMES)}).")
    return _Record(file if camera is None else str(camera), frame, time_ns, _people(row, where))


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


def _settle_frames(path: Path, records: Sequence[_Record]) -> tuple[list[int], list[float]]:
    """The frame of each record, and its time from the first, s: by number where all have one, else by time."""
    known = [record.time_ns for record in records if record.time_ns is not None]
    start = min(known, default=0)
    seconds = [np.nan if record.time_ns is None else (record.time_ns - start) * 1e-9 for record in records]
    numbers = [record.frame for record in records if record.frame is not None]
    if len(numbers) == len(records):
        return numbers, seconds
    if len(known) < len(records):
        raise FileError(f"{path}: some records say no time and some no frame; nothing tells which belong together.")
    period = _period_s(records, seconds)
    frames, last = [0] * len(records), dict[str, int]()
    for i in np.argsort(seconds, kind="stable").tolist():
        camera = records[i].camera
        # A camera whose clock jitters has no two frames at once.
        frames[i] = max(round(seconds[i] / period), last.get(camera, -1) + 1)
        last[camera] = frames[i]
    return frames, seconds


def _period_s(records: Sequence[_Record], seconds: Sequence[float]) -> float:
    steps: list[float] = []
    for camera in {record.camera for record in records}:
        mine = sorted(s for record, s in zip(records, seconds, strict=True) if record.camera == camera)
        steps += [step for step in np.diff(mine).tolist() if step > 0.0]
    return float(np.median(steps)) if steps else 1.0


def _view(
    path: Path, camera: str, records: Sequence[_Record], frames: Sequence[int], seconds: Sequence[float]
) -> ViewColumns:
    mine = [i for i, record in enumerate(records) if record.camera == camera]
    times = {frames[i]: seconds[i] for i in mine}
    if len(times) < len(mine):
        repeated = next(frames[i] for i in mine if [frames[j] for j in mine].count(frames[i]) > 1)
        raise FileError(f"{path}: camera {camera!r} has two records of frame {repeated}.")
    people = [Person(frames[i], person.values, person.track) for i in mine for person in records[i].people]
    columns = view_columns(camera, times, people, f"{path}, camera {camera!r}")
    time_s = np.array([times[frame] for frame in columns.recorded.tolist()])
    return ViewColumns(
        columns.name, columns.recorded, columns.frame_of_row, columns.keypoints, columns.track_ids,
        time_s=time_s if np.isfinite(time_s).any() else None,
    )  # fmt: skip
