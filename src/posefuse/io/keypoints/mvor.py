"""People of the MVOR data set: detections in ``openpose_kps.json``, or annotations in ``camma_mvor_2018.json``.

Frames are the triplets of images listed in ``camma_mvor_2018.json``, counted from 0; that file must be beside the
detections. Frames are 75 s apart, so there is no frame rate. Detections have COCO's 17 keypoints. Annotations have
person ids shared by the views, and ten joints named in the file.
"""

from pathlib import Path

import msgspec
import numpy as np

from posefuse.errors import FileError
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.people import Person, beginning, decode, detections_of, view_columns
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.from_names import skeleton_of
from posefuse.skeleton.skeletons import shipped_skeleton

_DATA = "camma_mvor_2018.json"


class _Image(msgspec.Struct):
    id: int


class _Triplet(msgspec.Struct):
    images: list[_Image]


class _Annotation(msgspec.Struct):
    image_id: int
    person_id: int
    keypoints: list[float]


class _Category(msgspec.Struct):
    keypoints: list[str]
    skeleton: list[tuple[int, int]] = []


class _Data(msgspec.Struct):
    multiview_images: list[_Triplet]
    annotations: list[_Annotation]
    categories: list[_Category]


class _Detected(msgspec.Struct):
    image_id: int
    coco_keypoints: list[float]


def matches(path: Path) -> bool:
    """Return whether a file is in this format."""
    return path.suffix == ".json" and path.is_file() and (_is_detected(path) or _is_data(path))


def _is_detected(path: Path) -> bool:
    start = beginning(path)
    return start.startswith(b"[{") and b'"coco_keypoints":' in start


def _is_data(path: Path) -> bool:
    return b'"multiview_images":' in beginning(path)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras, called ``camera_1``, ``camera_2``, ...

    Raises:
        FileError: If a file is truncated or in another format, or ``camma_mvor_2018.json`` is missing.
    """
    detected = _is_detected(path)
    data_file = path.with_name(_DATA) if detected else path
    if not data_file.is_file():
        raise FileError(f"{path} identifies images only by number. {_DATA} must be in the same folder to group them.")
    data: _Data = decode(data_file, _Data)
    n_views = max((len(triplet.images) for triplet in data.multiview_images), default=0)
    place = {image.id: (f, v) for f, each in enumerate(data.multiview_images) for v, image in enumerate(each.images)}
    people: list[list[Person]] = [[] for _ in range(n_views)]
    for image, values, track in _people(path, detected, data):
        if image not in place:
            raise FileError(f"{path}: a person is in image {image}, which {_DATA} does not list.")
        frame, view = place[image]
        people[view].append(Person(frame, values, track))
    frames = range(len(data.multiview_images))
    views = [view_columns(f"camera_{v + 1}", frames, each, str(path)) for v, each in enumerate(people)]
    return detections_of(path, views, _with_skeleton(request, detected, data))


def _people(path: Path, detected: bool, data: _Data) -> list[tuple[int, list[list[float]], int]]:
    """Return image, keypoints (x, y, confidence) and person id of each person, -1 for detections."""
    if detected:
        detections = decode(path, list[_Detected])
        return [(one.image_id, _triples(path, one.coco_keypoints), -1) for one in detections]
    people = []
    for one in data.annotations:
        values = np.array(_triples(path, one.keypoints))
        # Visibility (2 visible, 1 hidden) is not a confidence.
        values[:, 2] = np.where(values[:, 2] == 0, 0.0, 1.0)
        people.append((one.image_id, values.tolist(), one.person_id))
    return people


def _triples(path: Path, numbers: list[float]) -> list[list[float]]:
    if len(numbers) % 3 or not numbers:
        raise FileError(f"{path}: a person has {len(numbers)} numbers; expected x, y, confidence for each keypoint.")
    return np.array(numbers, dtype=np.float64).reshape(-1, 3).tolist()


def _with_skeleton(request: Request, detected: bool, data: _Data) -> Request:
    if request.skeleton is not None:
        return request
    skeleton = shipped_skeleton("coco_17")
    if not detected:
        if not data.categories:
            raise FileError(f"{_DATA} has no category, which names the keypoints.")
        names = data.categories[0].keypoints
        edges = [(names[a - 1], names[b - 1]) for a, b in data.categories[0].skeleton if max(a, b) <= len(names)]
        skeleton = skeleton_of("mvor", names, edges)
    return Request(skeleton, request.rate_hz, request.third_channel, request.progress)


FORMAT = KeypointFormat(
    name="mvor",
    files="openpose_kps.json beside camma_mvor_2018.json, or camma_mvor_2018.json alone",
    conventions=("px; frames are triplets of images 75 s apart; annotations have person ids; no frame rate: `rate_hz`"),
    recognized_by="JSON with multiview_images, or coco_keypoints",
    matches=matches,
    read=read,
)
