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
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.files import replacing
from posefuse.io.keypoints.columns import ViewColumns
from posefuse.io.keypoints.people import detections_of, whole
from posefuse.io.keypoints.request import Request, asked_of
from posefuse.io.netcdf import skeleton_from_text, skeleton_text
from posefuse.model.detections import Detections
from posefuse.model.skeletons import Skeleton, shipped_skeleton

_VERSION = 1
_Number = float | None


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
    """Read all frames.

    Raises:
        FileError: if a line is not whole, is none of a replay's, or people have different numbers of keypoints.
        SkeletonError: if neither the file nor the number of keypoints tells the skeleton.
    """
    with path.open("rb") as lines:
        head = _head(path, lines.readline())
        lines.seek(0)
        frames = list(_frames(path, lines, skip=head is not None, request=request))
    if not frames:
        raise FileError(f"{path} is an empty recording: it has no frames.")
    repeated = len(frames) - len({frame.frame for frame in frames})
    if repeated:
        raise FileError(f"{path} has {repeated} frames more than once.")
    frames.sort(key=lambda frame: frame.frame)
    seen = sorted({name for frame in frames for name in frame.cameras})
    names = head.cameras if head is not None else seen
    unknown = sorted(set(seen) - set(names))
    if unknown:
        raise FileError(f"{path} has detections of {choices(unknown)}, but its first line names {choices(names)}.")
    views = [_view(path, name, frames) for name in names]
    if head is None:
        return detections_of(path, views, request)
    skeleton = _skeleton(path, head.skeleton) or request.skeleton
    found = detections_of(path, views, Request(skeleton, head.rate_hz, progress=request.progress), tuple(head.notes))
    return asked_of(found, request, path)


def _head(path: Path, line: bytes) -> _Head | None:
    """The first line, if it is no frame."""
    if b'"replay"' not in line:
        return None
    try:
        head = _read_head.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(f"{path}, line 1 does not say what the replay is: {error}. Was it cut short?") from None
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


def _frames(path: Path, lines: Any, *, skip: bool, request: Request) -> Iterator[_Frame]:
    # How many lines there are nobody knows before they are read: what is told is how many bytes.
    request.progress.start("reading keypoints", path.stat().st_size)
    for number, line in enumerate(lines, start=1):
        request.progress.advance(len(line))
        if (skip and number == 1) or not line.strip():
            continue
        try:
            frame = _read_frame.decode(line)
        except msgspec.ValidationError as error:
            raise FileError(f"{path}, line {number} is no frame of a replay: {error}.") from None
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise FileError(f"{path}, line {number} is not whole JSON: {error}. Was it cut short?") from None
        whole(frame.frame, "frame", f"{path}, line {number}")
        yield frame
    request.progress.finish()


def _view(path: Path, name: str, frames: list[_Frame]) -> ViewColumns:
    mine = [(frame.frame, frame.cameras[name]) for frame in frames if name in frame.cameras]
    people = [(number, person) for number, camera in mine for person in camera.detections]
    rows = [_row(person, f"{path}, frame {number}, camera {name!r}") for number, person in people]
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise FileError(f"{path}, camera {name!r}: people have {lengths} keypoints; one recording has one skeleton.")
    n_keypoints = lengths[0] if lengths else 0
    values = np.array(rows).reshape(len(rows), n_keypoints, 5)
    values[np.isnan(values[..., :2]).any(axis=-1), :2] = np.nan
    times = [np.nan if camera.time_s is None else camera.time_s for _, camera in mine]
    known = np.isfinite(times).any()
    return ViewColumns(
        name=name,
        recorded=np.array([number for number, _ in mine], dtype=np.int64),
        frame_of_row=np.array([number for number, _ in people], dtype=np.int64),
        keypoints=values[..., :3],
        track_ids=np.array([_track(path, person) for _, person in people], dtype=np.int64),
        sigma_px=values[..., 3] if any(person.sigma_px is not None for _, person in people) else None,
        depth=values[..., 4] if any(person.depth is not None for _, person in people) else None,
        time_s=np.array(times) if known else None,
    )


def _track(path: Path, person: _Detection) -> int:
    return whole(person.track, "track", str(path))


def _row(person: _Detection, where: str) -> np.ndarray:
    """Shape (keypoint, 5): x, y, confidence, standard deviation, depth."""
    row = np.full((len(person.keypoints), 5), np.nan)
    for k, keypoint in enumerate(person.keypoints):
        if keypoint is None:
            continue
        if len(keypoint) not in (2, 3):
            raise FileError(f"{where}: a keypoint is [x, y] or [x, y, confidence], got {len(keypoint)} numbers.")
        row[k, : len(keypoint)] = keypoint
    for column, numbers in ((3, person.sigma_px), (4, person.depth)):
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
