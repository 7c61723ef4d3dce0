"""EasyMocap's and ViTPose's ``annots``: a folder a camera, a ``*.json`` a frame.

In it ``annots`` with ``personID`` and ``keypoints``: rows of x, y, confidence; 0 is missing. Frames that have no
file were not recorded.
"""

from pathlib import Path

import msgspec

from posefuse.io.keypoints.openpose import camera_folders, frame_files
from posefuse.io.keypoints.people import Person, beginning, decode, detections_of, last_number, view_columns
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections


class _Person(msgspec.Struct):
    keypoints: list[list[float]] = []
    personID: int = -1


class _Frame(msgspec.Struct):
    annots: list[_Person]


def matches(path: Path) -> bool:
    """Whether the folder holds such files, of one camera or of one camera a folder."""
    if not path.is_dir():
        return False
    folder = next(iter(camera_folders(path)), None)
    first = next(iter(frame_files(folder)), None) if folder else None
    return first is not None and b'"annots":' in beginning(first)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: if a file is cut short or another, or its name has no frame number.
        SkeletonError: if the number of keypoints does not tell the skeleton.
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
