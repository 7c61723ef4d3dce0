"""AlphaPose's own JSON (``alphapose-results.json``), one a camera: a list of people with ``image_id`` (a file's name).

``keypoints`` are x, y, score in a row; ``idx`` is the track, where tracking was on. Frames without people are not
in the file: all up to the last are taken to have been recorded, from 0.
"""

from pathlib import Path

import msgspec

from posefuse.io.keypoints.names import view_names
from posefuse.io.keypoints.people import (
    Person,
    beginning,
    camera_files,
    decode,
    detections_of,
    last_number,
    view_columns,
)
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections


class _Person(msgspec.Struct):
    image_id: str
    keypoints: list[float]
    idx: int | float | list[int | float] | None = None


def matches(path: Path) -> bool:
    """Whether a file is one, or a folder holds one a camera, or folders with one each."""
    return bool(_files(path))


def _files(path: Path) -> list[Path]:
    return camera_files(path, ".json", _is_one)


def _is_one(file: Path) -> bool:
    start = beginning(file)
    return start.startswith(b"[{") and b'"image_id":"' in start and b'"keypoints":' in start


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: if a file is cut short or another, or views have different keypoints.
        SkeletonError: if the number of keypoints does not tell the skeleton.
    """
    files = _files(path)
    views = []
    for file, name in zip(files, view_names(files), strict=True):
        people = [
            Person(last_number(one.image_id, str(file)), one.keypoints, _track(one))
            for one in decode(file, list[_Person])
        ]
        views.append(view_columns(name, None, people, str(file)))
    return detections_of(path, views, request)


def _track(person: _Person) -> int:
    given = person.idx[0] if isinstance(person.idx, list) and person.idx else person.idx
    return int(given) if isinstance(given, (int, float)) and 0 <= given < 2**40 else -1
