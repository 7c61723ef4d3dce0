"""Replays, ``*.jsonl`` or ``*.json``: frames with the detections of each camera. Frames without people are kept.

The first line of a ``.jsonl`` describes the recording. Every other line is a frame::

    {"replay": 1, "skeleton": {...} or "coco_17", "cameras": ["left", "right"], "rate_hz": 30.0, "notes": []}
    {"frame": 0, "cameras": {"left": {"time_s": 0.0, "detections": [
        {"track": 4, "keypoints": [[512.5, 300.25, 0.9], null, ...]}]}, "right": {"time_s": 0.0, "detections": []}}}

A keypoint is ``[x, y]`` or ``[x, y, confidence]`` in px, or ``null`` if it was not detected; an unknown confidence is
``null``. A camera that is absent from a line did not record the frame. ``sigma_px`` and ``depth`` of a detection are
lists with one number per keypoint. Without the first line, the cameras are sorted by name and the skeleton is inferred
from the number of keypoints.

A ``.json`` is one object, the description with the list ``frames``, or only the list of frames. Its ``cameras`` may be
names, or the cameras of a scene (:mod:`posefuse.io.calibration.scene`), so that one file holds a whole recording.

The specification requires a file with typed detections by frame and camera; the field
names are defined here.
"""

import json
from array import array
from collections.abc import Iterable, Iterator
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
    CellColumns,
    Record,
    RecordingInfo,
    check_numbers,
    detections_of_records,
    index_of,
)
from posefuse.io.keypoints.people import checked_integer
from posefuse.io.keypoints.request import Request, apply_request
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


class _Header(msgspec.Struct):
    replay: int
    cameras: list[str]
    skeleton: Any = None
    rate_hz: float | None = None
    notes: list[str] = []


class _SceneCamera(msgspec.Struct):
    name: str | int | None = None


class _Document(msgspec.Struct):
    frames: list[msgspec.Raw]
    replay: int = _VERSION
    cameras: list[str | _SceneCamera] = []
    skeleton: Any = None
    rate_hz: float | None = None
    notes: list[str] = []


_FrameText = tuple[str, Record, bytes]
"""A frame before it is decoded: where it is, for messages, its position in the file, and its JSON text."""

_read_frame = msgspec.json.Decoder(_Frame)
_read_header = msgspec.json.Decoder(_Header)
_read_document = msgspec.json.Decoder(_Document | list[msgspec.Raw])
_HEAD_BYTES = 1 << 16


def matches(path: Path) -> bool:
    """Return whether a file is in this format."""
    if path.suffix == ".json" and path.is_file():
        with path.open("rb") as file:
            start = file.read(_HEAD_BYTES)
        is_list = start.lstrip()[:1] == b"["
        return all(f'"{key}"'.encode() in start for key in ("frame", "cameras", "detections")) and (
            is_list or b'"frames"' in start
        )
    if path.suffix != ".jsonl" or not path.is_file():
        return False
    with path.open("rb") as lines:
        start = lines.readline(4096)
    return b'"cameras"' in start and (b'"replay"' in start or b'"frame"' in start)


def read(path: Path, request: Request) -> Detections:
    """Index all frames. Their numbers stay in the file and are read on demand.

    Raises:
        FileError: If a line is incomplete or not part of a replay, or people have different numbers of keypoints.
        SkeletonError: If neither the file nor the number of keypoints identifies a skeleton.
        DetectionsError: If a number is impossible.
    """
    if path.suffix == ".json":
        header, frames = _read_whole(path)
        content = _index(path, frames, request)
    else:
        with path.open("rb") as lines:
            header = _header(path, lines.readline())
            lines.seek(0)
            content = _index(path, _lines(path, lines, header), request)
    names = header.cameras if header is not None and header.cameras else sorted(content.names)
    unknown = sorted(set(content.names) - set(names))
    if unknown:
        raise FileError(
            f"{path} has detections of cameras that its description does not list: {choices(unknown)}. It lists "
            f"{choices(names)}."
        )
    views = np.array([names.index(name) for name in content.names], dtype=np.int64)
    cells = replace(content.cells, camera=array("q", views[np.array(content.cells.camera, dtype=np.int64)]))
    index = index_of(path, (path,), names, cells, content.n_keypoints)
    channels = (PIXELS, CONFIDENCE, *([SIGMA] if content.sigma else []), *([DEPTH] if content.depth else []))
    if header is None:
        info = RecordingInfo(request.skeleton, request.rate_hz, channels=channels)
        return detections_of_records(path, index, _people_of, _CHANNELS, info)
    skeleton = _skeleton(path, header.skeleton) or request.skeleton
    info = RecordingInfo(skeleton, header.rate_hz, tuple(header.notes), channels, own=True)
    return apply_request(detections_of_records(path, index, _people_of, _CHANNELS, info), request, path)


def _header(path: Path, line: bytes) -> _Header | None:
    """Return the description in the first line, or None if the first line is a frame."""
    if b'"replay"' not in line:
        return None
    try:
        header = _read_header.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(f"{path}, line 1 is not a valid replay header: {error}. Is the file truncated?") from None
    if header.replay != _VERSION:
        raise _other_version(path, header.replay)
    return header


def _other_version(path: Path, version: int) -> FileError:
    return FileError(f"{path} is a replay of version {version}; this version of posefuse reads {_VERSION}.")


def _read_whole(path: Path) -> tuple[_Header | None, list[_FrameText]]:
    """Return the description, if there is one, and the frames of a ``.json``."""
    text = path.read_bytes()
    try:
        document = _read_document.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(f"{path} is not a valid replay: {error}. Is the file truncated?") from None
    frames, at = [], 0
    for number, raw in enumerate(document if isinstance(document, list) else document.frames):
        frame = bytes(raw)
        # Only spaces and a comma separate the frames; the text before the first has none of their keys.
        at = text.index(frame, at)
        frames.append((f"{path}, frame {number} of the list", Record(0, at, len(frame)), frame))
        at += len(frame)
    if isinstance(document, list):
        return None, frames
    if document.replay != _VERSION:
        raise _other_version(path, document.replay)
    given = [each if isinstance(each, str) else each.name for each in document.cameras]
    names = [str(index if name is None else name) for index, name in enumerate(given)]
    if not names and (document.skeleton, document.rate_hz, document.notes) == (None, None, []):
        return None, frames
    return _Header(_VERSION, names, document.skeleton, document.rate_hz, document.notes), frames


def _skeleton(path: Path, content: Any) -> Skeleton | None:
    if content is None or isinstance(content, str):
        return None if content is None else shipped_skeleton(content)
    try:
        return skeleton_from_text(json.dumps(content))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as error:
        raise FileError(f"{path}: the skeleton is invalid: {error!r}.") from None


@dataclass
class _Content:
    """Index of the lines, collected line by line.

    Attributes:
        names: Names of the cameras, in order of first occurrence.
        cells: Cells, whose cameras are indices into ``names``.
        n_keypoints: Number of keypoints per person, 0 without people.
        sigma: Whether any person has standard deviations.
        depth: Whether any person has depths.
    """

    names: list[str] = field(default_factory=list)
    cells: CellColumns = field(default_factory=CellColumns)
    n_keypoints: int = 0
    sigma: bool = False
    depth: bool = False


def _lines(path: Path, lines: BinaryIO, header: _Header | None) -> Iterator[_FrameText]:
    """Yield the frames of a ``.jsonl``."""
    at = 0
    for number, line in enumerate(lines, start=1):
        start, at = at, at + len(line)
        if line.strip() and (header is None or number > 1):
            yield f"{path}, line {number}", Record(0, start, len(line)), line


def _index(path: Path, texts: Iterable[_FrameText], request: Request) -> _Content:
    # The number of frames is not known in advance, so progress counts bytes.
    request.progress.start("reading keypoints", path.stat().st_size)
    content, frames, n_frames = _Content(), set[int](), 0
    for where, record, text in texts:
        request.progress.advance(record.size)
        frame = _decoded(text, where)
        frames.add(checked_integer(frame.frame, "the frame", where))
        n_frames += 1
        _add_frame(content, frame, record, where)
    request.progress.finish()
    if not n_frames:
        raise FileError(f"{path} is an empty recording: it has no frames.")
    if len(frames) < n_frames:
        raise FileError(f"{path} contains {n_frames - len(frames)} duplicate frames.")
    return content


def _decoded(line: bytes, where: str) -> _Frame:
    try:
        return _read_frame.decode(line)
    except msgspec.ValidationError as error:
        raise FileError(f"{where} is not a frame of a replay: {error}.") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(f"{where} is not complete JSON: {error}. Is the file truncated?") from None


def _add_frame(content: _Content, frame: _Frame, record: Record, where: str) -> None:
    """Add the cells of a frame to the index."""
    for name, camera in frame.cameras.items():
        people = _rows(camera, f"{where}, camera {name!r}")
        if len(people):
            content.n_keypoints = content.n_keypoints or people.shape[1]
            if people.shape[1] != content.n_keypoints:
                raise FileError(
                    f"{where}, camera {name!r}: people have {people.shape[1]} keypoints, but others have "
                    f"{content.n_keypoints}. All must have the same skeleton."
                )
        content.sigma |= any(person.sigma_px is not None for person in camera.detections)
        content.depth |= any(person.depth is not None for person in camera.detections)
        if name not in content.names:
            content.names.append(name)
        time_s = np.nan if camera.time_s is None else camera.time_s
        tracks = [checked_integer(person.track, "the track", where) for person in camera.detections]
        content.cells.add(record, frame.frame, content.names.index(name), time_s, tracks)


def _people_of(line: bytes, _: Path, where: str) -> dict[str, np.ndarray]:
    """Return the people of each camera, shape (person, keypoint, 5): x, y, confidence, standard deviation, depth."""
    cameras = _decoded(line, where).cameras
    return {name: _rows(camera, f"{where}, camera {name!r}") for name, camera in cameras.items()}


def _rows(camera: _Camera, where: str) -> np.ndarray:
    rows = [_row(person, where) for person in camera.detections]
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise FileError(f"{where}: people have {lengths} keypoints. All must have the same skeleton.")
    people = np.array(rows).reshape(len(rows), lengths[0] if lengths else 0, _CHANNELS)
    check_numbers(people, where)
    people[np.isnan(people[..., :2]).any(axis=-1), :2] = np.nan
    return people


def _row(person: _Detection, where: str) -> np.ndarray:
    """Return the keypoints of a person, shape (keypoint, 5): x, y, confidence, standard deviation, depth."""
    row = np.full((len(person.keypoints), _CHANNELS), np.nan)
    filled = [_MISSING if keypoint is None else keypoint for keypoint in person.keypoints]
    lengths = set(map(len, filled))
    if not lengths <= {2, 3}:
        raise FileError(
            f"{where}: expected keypoints [x, y] or [x, y, confidence], got {max(lengths - {2, 3})} numbers."
        )
    if len(lengths) > 1:
        filled = [[*values, None][:3] for values in filled]
    if filled:
        row[:, : max(lengths)] = np.array(filled, dtype=np.float64)  # null becomes NaN
    for column, numbers in ((SIGMA[0], person.sigma_px), (DEPTH[0], person.depth)):
        if numbers is not None:
            if len(numbers) != len(row):
                raise FileError(f"{where}: expected one number for each of {len(row)} keypoints, got {len(numbers)}.")
            row[:, column] = numbers
    return row


def write(detections: Detections, path: Path) -> None:
    """Write a replay, one range of frames after another.

    Raises:
        FileError: If the file cannot be written.
    """
    encoder = msgspec.json.Encoder()
    header = _Header(
        replay=_VERSION,
        cameras=list(detections.view_names),
        skeleton=json.loads(skeleton_text(detections.skeleton)),
        rate_hz=detections.rate_hz,
        notes=list(detections.notes),
    )
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(encoder.encode(header) + b"\n")
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
    # The encoder writes NaN as null.
    pixels, confidence = np.asarray(detections.keypoints_px)[row], np.asarray(detections.confidence)[row]
    values = np.concatenate([pixels, confidence[:, None]], axis=1)
    person = {
        "track": int(np.asarray(detections.track_ids)[row]),
        "keypoints": [None if np.isnan(keypoint).all() else keypoint.tolist() for keypoint in values],
    }
    for name in ("sigma_px", "depth"):
        if getattr(detections, name) is not None:
            person[name] = np.asarray(getattr(detections, name))[row].tolist()
    return person


def lost(detections: Detections, path: Path) -> tuple[str, ...]:
    """Return what of the detections is lost in the file: nothing."""
    return ()


FORMAT = KeypointFormat(
    name="replay",
    files="*.jsonl, one line per frame with the detections of each camera, or *.json with a list of frames",
    conventions="px; null is missing; frames without people are kept; lossless",
    matches=matches,
    read=read,
    write=write,
    lost=lost,
    endings=(".jsonl",),
)
