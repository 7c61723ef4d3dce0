"""COCO's keypoint JSON, one a camera: results (a list with ``image_id``), or ``images`` with ``annotations``.

Of results ``image_id`` is the frame, and all frames up to the last are taken to have been recorded, from 0. Of
annotations the frame is the last number in an image's ``file_name``, the images are the frames, and ``categories``
name the keypoints; a visibility of 0 is missing, 1 (hidden) and 2 say nothing about confidence.
"""

from pathlib import Path

import msgspec
import numpy as np

from posefuse.errors import FileError
from posefuse.io.keypoints.names import skeleton_of, view_names
from posefuse.io.keypoints.people import (
    Person,
    beginning,
    camera_files,
    decode,
    detections_of,
    last_number,
    view_columns,
    whole,
)
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.model.skeletons import Skeleton


class _Result(msgspec.Struct):
    image_id: int
    keypoints: list[float]
    track_id: int | None = None


class _Image(msgspec.Struct):
    id: int
    file_name: str


class _Category(msgspec.Struct):
    id: int
    keypoints: list[str] = []
    skeleton: list[list[int]] = []


class _Annotations(msgspec.Struct):
    images: list[_Image]
    annotations: list[_Result]
    categories: list[_Category] = []


def matches(path: Path) -> bool:
    """Whether a file is one, or a folder holds one a camera, or folders with one each."""
    return bool(_files(path))


def _files(path: Path) -> list[Path]:
    return camera_files(path, ".json", lambda file: _is_results(file) or _is_annotations(file))


def _is_results(file: Path) -> bool:
    start = beginning(file)
    numbered = b'"image_id":' in start and b'"image_id":"' not in start
    mvor = b'"coco_keypoints":' in start
    return start.startswith(b"[{") and numbered and b'"keypoints":' in start and not mvor


def _is_annotations(file: Path) -> bool:
    start = beginning(file, 200_000)
    if (
        not start.startswith(b"{")
        or b'"multiview_images":' in start
        or not (b'"images":' in start or b'"annotations":' in start)
    ):
        return False
    try:
        return any(category.keypoints for category in decode(file, _Annotations).categories)
    except FileError:
        return False


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: if a file is cut short or another, or views have different keypoints.
        SkeletonError: if the number of keypoints does not tell the skeleton.
    """
    files = _files(path)
    views, skeleton = [], request.skeleton
    for file, name in zip(files, view_names(files), strict=True):
        if _is_results(file):
            people = [_person(one, one.image_id, str(file)) for one in decode(file, list[_Result])]
            views.append(view_columns(name, None, people, str(file)))
            continue
        content: _Annotations = decode(file, _Annotations)
        skeleton = skeleton or _skeleton(content)
        frames = {image.id: last_number(image.file_name, str(file)) for image in content.images}
        people = [_annotated(one, frames, str(file)) for one in content.annotations if len(one.keypoints)]
        views.append(view_columns(name, set(frames.values()), people, str(file)))
    told = Request(skeleton, request.rate_hz, request.third_channel, request.progress)
    return detections_of(path, views, told)


def _person(one: _Result, frame: int, where: str) -> Person:
    track = -1 if one.track_id is None else whole(one.track_id, "track_id", where)
    return Person(whole(frame, "image_id", where), one.keypoints, track)


def _annotated(one: _Result, frames: dict[int, int], where: str) -> Person:
    if one.image_id not in frames:
        raise FileError(f"{where}: an annotation is of image {one.image_id}, which is not among the images.")
    person = _person(one, frames[one.image_id], where)
    values = np.array(one.keypoints)
    if values.size % 3 == 0:
        values = values.reshape(-1, 3)
        values[values[:, 2] == 0] = np.nan
        values[:, 2] = np.where(np.isnan(values[:, 0]), np.nan, 1.0)
    return Person(person.frame, values, person.track)


def _skeleton(content: _Annotations) -> Skeleton | None:
    category = next((one for one in content.categories if one.keypoints), None)
    if category is None:
        return None
    names = category.keypoints
    inside = range(1, len(names) + 1)
    edges = [(names[a - 1], names[b - 1]) for a, b in category.skeleton if a in inside and b in inside and a != b]
    return skeleton_of("coco", names, edges)
