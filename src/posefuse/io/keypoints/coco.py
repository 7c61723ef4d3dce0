"""COCO keypoint JSON, one per camera: results (a list with ``image_id``), or ``images`` with ``annotations``.

In results, ``image_id`` is the frame, and all frames from 0 to the last are assumed to have been recorded. In
annotations, the frame is the last number in the ``file_name`` of an image, the images are the recorded frames, and
``categories`` names the keypoints; visibility 0 is missing, 1 (hidden) and 2 (visible) are not confidences.
"""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from posefuse.errors import FileError
from posefuse.io.keypoints.camera_files import FileKind, all_camera_files, read_views, valid_camera_files
from posefuse.io.keypoints.columns import ViewColumns
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.people import (
    Person,
    beginning,
    checked_integer,
    decode,
    detections_of,
    last_number,
    view_columns,
)
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.from_names import skeleton_of
from posefuse.skeleton.skeletons import Skeleton


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
    skeleton: list[tuple[int, int]] = []


class _Annotations(msgspec.Struct):
    images: list[_Image]
    annotations: list[_Result]
    categories: list[_Category] = []


def matches(path: Path) -> bool:
    """Return whether a path is a file in this format, or a folder or folders with one per camera."""
    return bool(valid_camera_files(path, _KIND))


def files_of(path: Path) -> list[Path]:
    """Return the files, including damaged ones, because a camera must not be dropped silently."""
    return all_camera_files(path, _KIND)


def _is_results(file: Path) -> bool:
    start = beginning(file)
    numbered = b'"image_id":' in start and b'"image_id":"' not in start
    mvor = b'"coco_keypoints":' in start
    return start.startswith(b"[{") and numbered and b'"keypoints":' in start and not mvor


def _is_annotations(file: Path) -> bool:
    if not _looks_annotated(file):
        return False
    try:
        return any(category.keypoints for category in decode(file, _Annotations).categories)
    except FileError:
        return False


def _looks_annotated(file: Path) -> bool:
    start = beginning(file, 200_000)
    named = b'"images":' in start or b'"annotations":' in start
    return start.startswith(b"{") and named and b'"multiview_images":' not in start


def _is_similar(file: Path) -> bool:
    """Return whether a file has empty results, results of images, or broken annotations."""
    start = beginning(file)
    return start == b"[]" or (start.startswith(b"[") and b'"image_id":' in start) or _looks_annotated(file)


_KIND = FileKind((".json",), lambda file: _is_results(file) or _is_annotations(file), _is_similar)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: If a file is truncated or in another format, or views have different keypoints.
        SkeletonError: If neither the names nor the number of keypoints identify a skeleton.
    """
    skeletons: list[Skeleton] = []

    def read_one(file: Path, name: str) -> ViewColumns:
        if not _looks_annotated(file):
            people = [_person(one, one.image_id, str(file)) for one in decode(file, list[_Result])]
            return view_columns(name, None, people, str(file))
        content: _Annotations = decode(file, _Annotations)
        skeletons.extend(_skeletons(content))
        return _annotated_view(file, name, content)

    views = read_views(path, _KIND, request, read_one)
    return detections_of(path, views, replace(request, skeleton=request.skeleton or next(iter(skeletons), None)))


def _annotated_view(file: Path, name: str, content: _Annotations) -> ViewColumns:
    frames = {image.id: last_number(image.file_name, str(file)) for image in content.images}
    people = [_annotated(one, frames, str(file)) for one in content.annotations if len(one.keypoints)]
    return view_columns(name, set(frames.values()), people, str(file))


def _person(one: _Result, frame: int, where: str) -> Person:
    track = -1 if one.track_id is None else checked_integer(one.track_id, "track_id", where)
    return Person(checked_integer(frame, "image_id", where), one.keypoints, track)


def _annotated(one: _Result, frames: dict[int, int], where: str) -> Person:
    if one.image_id not in frames:
        raise FileError(f"{where}: an annotation refers to image {one.image_id}, which is not listed.")
    person = _person(one, frames[one.image_id], where)
    values = np.array(one.keypoints)
    if values.size % 3 == 0:
        values = values.reshape(-1, 3)
        values[values[:, 2] == 0] = np.nan
        values[:, 2] = np.where(np.isnan(values[:, 0]), np.nan, 1.0)
    return Person(person.frame, values, person.track)


def _skeletons(content: _Annotations) -> list[Skeleton]:
    """Return the skeleton of the first category that names keypoints, or none."""
    category = next((one for one in content.categories if one.keypoints), None)
    if category is None:
        return []
    names = category.keypoints
    inside = range(1, len(names) + 1)
    edges = [(names[a - 1], names[b - 1]) for a, b in category.skeleton if a in inside and b in inside and a != b]
    return [skeleton_of("coco", names, edges)]


FORMAT = KeypointFormat(
    name="coco",
    files="one *.json of results or annotations per camera",
    conventions="px; x y score or visibility; no frame rate: `rate_hz`",
    recognized_by="JSON with image_id or images, and keypoints",
    matches=matches,
    read=read,
    camera_files=files_of,
)
