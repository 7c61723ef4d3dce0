"""``annots`` of EasyMocap and ViTPose: one folder per camera, one ``*.json`` per frame.

A file has ``annots`` with ``personID`` and ``keypoints``, rows of x, y, confidence; 0 is missing. Frames without a file
were not recorded.
"""

from pathlib import Path

import msgspec

from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.openpose import camera_folders, first_bytes, frame_files
from posefuse.io.keypoints.people import Person, decode, detections_of, last_number, view_columns
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections


class _Person(msgspec.Struct):
    keypoints: list[list[float]] = []
    personID: int = -1


class _Frame(msgspec.Struct):
    annots: list[_Person]


def matches(path: Path) -> bool:
    """Return whether a folder contains such files of one camera, or one folder of them per camera."""
    return path.is_dir() and any(b'"annots":' in start for start in first_bytes(path))


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: If a file is truncated or in another format, or its name has no frame number.
        SkeletonError: If the number of keypoints does not identify a skeleton.
    """
    files = {folder: frame_files(folder) for folder in camera_folders(path)}
    request.progress.start("reading keypoints", sum(map(len, files.values())))
    views = []
    for folder, frames in files.items():
        people, recorded = [], []
        for file in frames:
            number = last_number(file.name, str(file))
            recorded.append(number)
            people += [
                Person(number, one.keypoints, one.personID) for one in decode(file, _Frame).annots if one.keypoints
            ]
            request.progress.advance(1)
        views.append(view_columns(folder.name, recorded, people, str(folder)))
    request.progress.finish()
    return detections_of(path, views, request)


FORMAT = KeypointFormat(
    name="easymocap",
    files="annots: one folder per camera, one *.json per frame (also ViTPose)",
    conventions="px; x y confidence, 0 0 is missing; no frame rate: `rate_hz`",
    recognized_by='one folder per camera with numbered JSON files that contain "annots"',
    matches=matches,
    read=read,
)
