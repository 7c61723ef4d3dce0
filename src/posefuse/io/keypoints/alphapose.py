"""AlphaPose's own JSON (``alphapose-results.json``), one per camera: a list of people with ``image_id``, a file name.

``keypoints`` is a flat list of x, y, score; ``idx`` is the track if tracking was on. Frames without people are absent
from the file: all frames from 0 to the last are assumed to have been recorded.
"""

from pathlib import Path

import msgspec

from posefuse.io.keypoints.camera_files import FileKind, all_camera_files, read_views, valid_camera_files
from posefuse.io.keypoints.columns import ViewColumns
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.people import Person, beginning, decode, detections_of, last_number, view_columns
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections


class _Person(msgspec.Struct):
    image_id: str
    keypoints: list[float]
    idx: int | float | list[int | float] | None = None


def matches(path: Path) -> bool:
    """Return whether a path is a file in this format, or a folder or folders with one per camera."""
    return bool(valid_camera_files(path, _KIND))


def files_of(path: Path) -> list[Path]:
    """Return the files, including damaged ones, because a camera must not be dropped silently."""
    return all_camera_files(path, _KIND)


def _is_one(file: Path) -> bool:
    start = beginning(file)
    return start.startswith(b"[{") and b'"image_id":"' in start and b'"keypoints":' in start


def _is_similar(file: Path) -> bool:
    """Return whether a file is an empty list, or a list of objects with an image id."""
    start = beginning(file)
    return start == b"[]" or (start.startswith(b"[") and b'"image_id":' in start)


_KIND = FileKind((".json",), _is_one, _is_similar)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: If a file is truncated or in another format, or views have different keypoints.
        SkeletonError: If the number of keypoints does not identify a skeleton.
    """
    return detections_of(path, read_views(path, _KIND, request, _read_view), request)


def _read_view(file: Path, name: str) -> ViewColumns:
    where = str(file)
    people = [
        Person(last_number(one.image_id, where), one.keypoints, _track(one)) for one in decode(file, list[_Person])
    ]
    return view_columns(name, None, people, where)


def _track(person: _Person) -> int:
    track = person.idx[0] if isinstance(person.idx, list) and person.idx else person.idx
    return int(track) if isinstance(track, (int, float)) and 0 <= track < 2**40 else -1


FORMAT = KeypointFormat(
    name="alphapose",
    files="one alphapose-results.json per camera",
    conventions="px; x y score; frames without people are absent; no frame rate: `rate_hz`",
    recognized_by="JSON list with keypoints, and a file name as image_id",
    matches=matches,
    read=read,
    camera_files=files_of,
)
