"""Replays, ``*.jsonl``: a line a frame, in it each camera's detections; frames and cameras that show nobody stay.

The first line says what the recording is; every other line is a frame::

    {"replay": 1, "skeleton": {...} or "coco_17", "cameras": ["left", "right"], "rate_hz": 30.0, "notes": []}
    {"frame": 0, "cameras": {"left": {"time_s": 0.0, "detections": [
        {"track": 4, "keypoints": [[512.5, 300.25, 0.9], null, ...]}]}, "right": {"time_s": 0.0, "detections": []}}}

A keypoint is ``[x, y]`` or ``[x, y, confidence]`` in px, ``null`` where it was not detected; ``null`` for a confidence
that the detector did not give. A camera that is not in a line did not record the frame. ``sigma_px`` and ``depth`` of a
detection are lists of a number a keypoint. Without a first line cameras are those that are there, sorted, and the
number of keypoints tells the skeleton. The specification names this file and says that it holds typed detections by
frame and camera; the names of its fields are ours.
"""

import json
from array import array
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.files import replacing
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.lines import (
    CONFIDENCE,
    DEPTH,
    PIXELS,
    SIGMA,
    Cells,
    Record,
    Told,
    detections_of_lines,
    index_of,
    must_be_possible,
)
from posefuse.io.keypoints.people import whole
from posefuse.io.keypoints.request import Request, asked_of
from posefuse.io.netcdf import skeleton_from_text, skeleton_text
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton

_VERSION = 1
_CHANNELS = 5
_Number = float | None
_MISSING: list[_Number] = [None, None, None]


class _Detection(msgspec.Struct):
    keypoints: list[list[_Number] | None]
    track: int = -1
    sigma_px: list[_Number] | None = None
    depth: list[_Number] | None = None


class _Camera(msgspec.Struct):
    detections: list[_Detection]
    time_s: float | None = None


class _Frame(msgspec.Struct):
    frame: int
    cameras: dict[str, _Camera]


class _Head(msgspec.Struct):
    replay: int
    cameras: list[str]
    skeleton: Any = None
    rate_hz: float | None = None
    notes: list[str] = []


_read_frame = msgspec.json.Decoder(_Frame)
_read_head = msgspec.json.Decoder(_Head)


def matches(path: Path) -> bool:
    """Whether the file is one."""
    if path.suffix != ".jsonl" or not path.is_file():
        return False
    with path.open("rb") as lines:
        start = lines.readline(4096)
    return b'"cameras"' in start and (b'"replay"' in start or b'"frame"' in start)


def read(path: Path, request: Request) -> Detections:
    """Look through all frames; their numbers stay in the file.

    Raises:
        FileError: if a line is not whole, is none of a replay's, or people have different numbers of keypoints.
        SkeletonError: if neither the file nor the number of keypoints tells the skeleton.
        DetectionsError: if a number cannot be.
    """
    with path.open("rb") as lines:
        head = _head(path, lines.readline())
        lines.seek(0)
        found = _look_through(path, lines, head, request)
    names = head.cameras if head is not None else sorted(found.names)
    unknown = sorted(set(found.names) - set(names))
    if unknown:
        raise FileError(f"{path} has detections of {choices(unknown)}, but its first line names {choices(names)}.")
    places = np.array([names.index(name) for name in found.names], dtype=np.int64)
    cells = replace(found.cells, camera=array("q", places[np.array(found.cells.camera, dtype=np.int64)]))
    index = index_of(path, (path,), names, cells, found.n_keypoints)
    channels = (PIXELS, CONFIDENCE, *([SIGMA] if found.sigma else []), *([DEPTH] if found.depth else []))
    if head is None:
        told = Told(request.skeleton, request.rate_hz, channels=channels)
        return detections_of_lines(path, index, _people_of, _CHANNELS, told)
    told = Told(_skeleton(path, head.skeleton) or request.skeleton, head.rate_hz, tuple(head.notes), channels, own=True)
    return asked_of(detections_of_lines(path, index, _people_of, _CHANNELS, told), request, path)


def _head(path: Path, line: bytes) -> _Head | None:
    """The first line, if it is no frame."""
    if b'"replay"' not in line:
        return None
    try:
        head = _read_head.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(f"{path}, line 1 does not say what the replay is: {error}. Is the file truncated?") from None
    if head.replay != _VERSION:
        raise FileError(f"{path} is a replay of layout {head.replay}; this version of posefuse reads {_VERSION}.")
    return head


def _skeleton(path: Path, said: Any) -> Skeleton | None:
    if said is None or isinstance(said, str):
        return None if said is None else shipped_skeleton(said)
    try:
        return skeleton_from_text(json.dumps(said))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as error:
        raise FileError(f"{path}, line 1: the skeleton is none: {error!r}.") from None


@dataclass
class _Found:
    """What a look through the lines finds, line by line.

    Attributes:
        names: of the cameras, in the order in which they come.
        cells: whose cameras are places in ``names``.
        n_keypoints: of each person; 0 where there is nobody.
        sigma: whether somebody has standard deviations.
        depth: whether somebody has depths.
    """

    names: list[str] = field(default_factory=list)
    cells: Cells = field(default_factory=Cells)
    n_keypoints: int = 0
    sigma: bool = False
    depth: bool = False


def _look_through(path: Path, lines: BinaryIO, head: _Head | None, request: Request) -> _Found:
    # How many lines there are nobody knows before they are read: what is told is how many bytes.
    request.progress.start("reading keypoints", path.stat().st_size)
    found, seen, at, n_frames = _Found(), set[int](), 0, 0
    for number, line in enumerate(lines, start=1):
        start, at = at, at + len(line)
        request.progress.advance(len(line))
        if (head is not None and number == 1) or not line.strip():
            continue
        where = f"{path}, line {number}"
        frame = _decoded(line, where)
        seen.add(whole(frame.frame, "frame", where))
        n_frames += 1
        _note(found, frame, Record(0, start, len(line)), where)
    request.progress.finish()
    if not n_frames:
        raise FileError(f"{path} is an empty recording: it has no frames.")
    if len(seen) < n_frames:
        raise FileError(f"{path} has {n_frames - len(seen)} frames more than once.")
    return found


def _decoded(line: bytes, where: str) -> _Frame:
    try:
        return _read_frame.decode(line)
    except msgspec.ValidationError as error:
        raise FileError(f"{where} is no frame of a replay: {error}.") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(f"{where} is not whole JSON: {error}. Is the file truncated?") from None


def _note(found: _Found, frame: _Frame, record: Record, where: str) -> None:
    """Note who is in a frame."""
    for name, camera in frame.cameras.items():
        people = _rows(camera, f"{where}, camera {name!r}")
        if len(people):
            found.n_keypoints = found.n_keypoints or people.shape[1]
            if people.shape[1] != found.n_keypoints:
                raise FileError(
                    f"{where}, camera {name!r}: people have {people.shape[1]} keypoints, others have "
                    f"{found.n_keypoints}; one recording has one skeleton."
                )
        found.sigma |= any(person.sigma_px is not None for person in camera.detections)
        found.depth |= any(person.depth is not None for person in camera.detections)
        if name not in found.names:
            found.names.append(name)
        time_s = np.nan if camera.time_s is None else camera.time_s
        tracks = [whole(person.track, "track", where) for person in camera.detections]
        found.cells.add(record, frame.frame, found.names.index(name), time_s, tracks)


def _people_of(line: bytes, _: Path, where: str) -> dict[str, np.ndarray]:
    """Of each camera in a line shape (person, keypoint, 5): x, y, confidence, standard deviation, depth."""
    cameras = _decoded(line, where).cameras
    return {name: _rows(camera, f"{where}, camera {name!r}") for name, camera in cameras.items()}


def _rows(camera: _Camera, where: str) -> np.ndarray:
    rows = [_row(person, where) for person in camera.detections]
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise FileError(f"{where}: people have {lengths} keypoints; one recording has one skeleton.")
    people = np.array(rows).reshape(len(rows), lengths[0] if lengths else 0, _CHANNELS)
    must_be_possible(people, where)
    people[np.isnan(people[..., :2]).any(axis=-1), :2] = np.nan
    return people


def _row(person: _Detection, where: str) -> np.ndarray:
    """Shape (keypoint, 5): x, y, confidence, standard deviation, depth."""
    row = np.full((len(person.keypoints), _CHANNELS), np.nan)
    filled = [_MISSING if keypoint is None else keypoint for keypoint in person.keypoints]
    lengths = set(map(len, filled))
    if not lengths <= {2, 3}:
        odd = max(lengths - {2, 3})
        raise FileError(f"{where}: a keypoint is [x, y] or [x, y, confidence], got {odd} numbers.")
    if len(lengths) > 1:
        filled = [[*values, None][:3] for values in filled]
    if filled:
        row[:, : max(lengths)] = np.array(filled, dtype=np.float64)  # null becomes NaN
    for column, numbers in ((SIGMA[0], person.sigma_px), (DEPTH[0], person.depth)):
        if numbers is not None:
            if len(numbers) != len(row):
                raise FileError(f"{where}: {len(numbers)} numbers for {len(row)} keypoints.")
            row[:, column] = numbers
    return row


def write(detections: Detections, path: Path) -> None:
    """Write a replay, range by range."""
    encoder = msgspec.json.Encoder()
    head = _Head(
        replay=_VERSION,
        cameras=list(detections.view_names),
        skeleton=json.loads(skeleton_text(detections.skeleton)),
        rate_hz=detections.rate_hz,
        notes=list(detections.notes),
    )
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(encoder.encode(head) + b"\n")
        for chunk in detections.chunks():
            for f in range(chunk.n_frames):
                file.write(encoder.encode(_frame_of(chunk, f)) + b"\n")


def _frame_of(detections: Detections, f: int) -> dict[str, Any]:
    cameras = {}
    for v, name in enumerate(detections.view_names):
        if not detections.recorded[f, v]:
            continue
        start, stop = detections.offsets[f * detections.n_views + v :][:2]
        cameras[name] = {"time_s": float(detections.time_s[f, v])} | {
            "detections": [_detection(detections, row) for row in range(start, stop)]
        }
    return {"frame": int(detections.frame_numbers[f]), "cameras": cameras}


def _detection(detections: Detections, row: int) -> dict[str, Any]:
    # NaN is encoded as null.
    pixels, trust = np.asarray(detections.keypoints_px)[row], np.asarray(detections.confidence)[row]
    values = np.concatenate([pixels, trust[:, None]], axis=1)
    person = {
        "track": int(np.asarray(detections.track_ids)[row]),
        "keypoints": [None if np.isnan(keypoint).all() else keypoint.tolist() for keypoint in values],
    }
    for name in ("sigma_px", "depth"):
        if getattr(detections, name) is not None:
            person[name] = np.asarray(getattr(detections, name))[row].tolist()
    return person


def lost(detections: Detections, path: Path) -> tuple[str, ...]:
    """What of these detections the file cannot hold: nothing."""
    return ()


FORMAT = KeypointFormat(
    name="replay",
    files="*.jsonl, one line per frame with the detections of each camera",
    conventions="px; null is missing; frames without people are kept; lossless",
    matches=matches,
    read=read,
    write=write,
    lost=lost,
    endings=(".jsonl",),
)
