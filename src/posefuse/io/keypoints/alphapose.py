"""AlphaPose's own JSON (``alphapose-results.json``), one a camera: a list of people with ``image_id`` (a file's name).

``keypoints`` are x, y, score in a row; ``idx`` is the track, where tracking was on. Frames without people are not
in the file: all up to the last are taken to have been recorded, from 0.
"""

from pathlib import Path

import msgspec

from posefuse.io.keypoints.camera_files import FileKind, all_camera_files, camera_files, read_views
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
    """Whether a file is one, or a folder holds one a camera, or folders with one each."""
    return bool(camera_files(path, _KIND))


def files_of(path: Path) -> list[Path]:
    """The files, damaged ones too: a camera must not go missing unsaid."""
    return all_camera_files(path, _KIND)


def _is_one(file: Path) -> bool:
    start = beginning(file)
    return start.startswith(b"[{") and b'"image_id":"' in start and b'"keypoints":' in start


def _was_meant(file: Path) -> bool:
    """A list in which nobody is, or of something that is of an image."""
    start = beginning(file)
    return start == b"[]" or (start.startswith(b"[") and b'"image_id":' in start)


_KIND = FileKind((".json",), _is_one, _was_meant)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: if a file is cut short or another, or views have different keypoints.
        SkeletonError: if the number of keypoints does not tell the skeleton.
    """
    return detections_of(path, read_views(path, _KIND, request, _read_view), request)


def _read_view(file: Path, name: str) -> ViewColumns:
    where = str(file)
    people = [
        Person(last_number(one.image_id, where), one.keypoints, _track(one)) for one in decode(file, list[_Person])
    ]
    return view_columns(name, None, people, where)


def _track(person: _Person) -> int:
    given = person.idx[0] if isinstance(person.idx, list) and person.idx else person.idx
    return int(given) if isinstance(given, (int, float)) and 0 <= given < 2**40 else -1


FORMAT = KeypointFormat(
    name="alphapose",
    files="one alphapose-results.json per camera",
    conventions="px; x y score; frames without people are absent; no frame rate: --rate-hz",
    recognized_by="JSON list with keypoints, and a file name as image_id",
    matches=matches,
    read=read,
    camera_files=files_of,
)
