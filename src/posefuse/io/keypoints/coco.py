"""COCO's keypoint JSON, one a camera: results (a list with ``image_id``), or ``images`` with ``annotations``.

Of results ``image_id`` is the frame, and all frames up to the last are taken to have been recorded, from 0. Of
annotations the frame is the last number in an image's ``file_name``, the images are the frames, and ``categories``
name the keypoints; a visibility of 0 is missing, 1 (hidden) and 2 say nothing about confidence.
"""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from posefuse.errors import FileError
from posefuse.io.keypoints.camera_files import FileKind, all_camera_files, camera_files, read_views
from posefuse.io.keypoints.columns import ViewColumns
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.names import skeleton_of
from posefuse.io.keypoints.people import Person, beginning, decode, detections_of, last_number, view_columns, whole
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
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
    """Whether a file is one, or a folder holds one a camera, or folders with one each."""
    return bool(camera_files(path, _KIND))


def files_of(path: Path) -> list[Path]:
    """The files, damaged ones too: a camera must not go missing unsaid."""
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


def _was_meant(file: Path) -> bool:
    """Results of which there is none, or of images; annotations that something is wrong with."""
    start = beginning(file)
    return start == b"[]" or (start.startswith(b"[") and b'"image_id":' in start) or _looks_annotated(file)


_KIND = FileKind((".json",), lambda file: _is_results(file) or _is_annotations(file), _was_meant)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: if a file is cut short or another, or views have different keypoints.
        SkeletonError: if the number of keypoints does not tell the skeleton.
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


def _skeletons(content: _Annotations) -> list[Skeleton]:
    """Of the first category that names keypoints."""
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
    conventions="px; x y score or visibility; no frame rate: --rate-hz",
    recognized_by="JSON with image_id or images, and keypoints",
    matches=matches,
    read=read,
    camera_files=files_of,
)
