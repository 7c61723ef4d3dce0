"""MediaPipe landmarks in JSON or CSV, one file per camera.

JSON: a list of frames, or an object with ``frames`` and optionally ``width``, ``height`` (or ``image_width``,
``image_height``) and ``fps``. A frame has ``pose_landmarks`` (or ``poseLandmarks``, ``landmarks``): the 33 landmarks of
one person, or a list of people, or ``{"landmark": [...]}`` like protobuf dictionaries, each landmark with ``x``, ``y``,
``z``, ``visibility``; ``face_landmarks``, ``left_hand_landmarks`` and ``right_hand_landmarks`` of one person;
``frame`` and ``timestamp_ms``. A frame without landmarks is a frame without people.

CSV: one row per frame with ``nose_x, nose_y, nose_z, nose_visibility, ...`` (any case) or ``x0, y0, z0, v0, ...`` (from
0 or 1); or one row per landmark with ``frame``, ``landmark`` (name or number), ``x``, ``y``, ``z``, ``visibility``.

MediaPipe outputs fractions of the image width and height; values above 3 are pixels. The size of the image is stated by
the file or by ``--image-size``. ``visibility`` is the confidence. ``z``, in image widths, is multiplied by the width to
give the depth in px, like in FreeMoCap.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.keypoints import mediapipe_csv
from posefuse.io.keypoints.camera_files import FileKind, all_camera_files
from posefuse.io.keypoints.columns import ViewColumns, assemble
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.mediapipe_csv import Landmarks
from posefuse.io.keypoints.names import view_names
from posefuse.io.keypoints.people import beginning, checked_integer, decode
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton

_BODY, _HAND, _FACE, _FACE_WITH_IRISES = 33, 21, 468, 478
_POSE = ("pose_landmarks", "poseLandmarks", "landmarks")
_LEFT, _RIGHT = ("left_hand_landmarks", "leftHandLandmarks"), ("right_hand_landmarks", "rightHandLandmarks")
_MESH = ("face_landmarks", "faceLandmarks")
_MAX_FRACTION = 3.0


def matches(path: Path) -> bool:
    """Return whether a path is a file in this format or a folder that contains some, one level deep."""
    return bool(files_of(path))


def files_of(path: Path) -> list[Path]:
    """Return the files, including damaged ones, because a camera must not be dropped silently."""
    return all_camera_files(path, _KIND)


def _is_one(file: Path) -> bool:
    if file.suffix == ".csv":
        return mediapipe_csv.matches(file)
    start = beginning(file, 20_000)
    named = any(f'"{name}":'.encode() in start for name in _POSE)
    return file.suffix == ".json" and start[:1] in (b"{", b"[") and named and (b'"x":' in start or b"null" in start)


_KIND = FileKind((".json", ".csv"), _is_one)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: If a file is truncated, or coordinates are fractions of an image of unknown size.
    """
    files = files_of(path)
    request.progress.start("reading keypoints", len(files))
    cameras: list[Landmarks] = []
    for file in files:
        cameras.append(mediapipe_csv.read(file) if file.suffix == ".csv" else _read_json(file))
        request.progress.advance(1)
    request.progress.finish()
    skeleton = _skeleton(path, cameras, request)
    views = [_view(file, name, each, skeleton, request) for file, name, each in
             zip(files, view_names(files), cameras, strict=True)]  # fmt: skip
    rates = {each.rate_hz for each in cameras if each.rate_hz}
    if len(rates) > 1:
        raise FileError(
            f"{path}: the cameras have different frame rates ({sorted(rates)} Hz). Choose one with `rate_hz`."
        )
    rate = request.rate_hz or next(iter(rates), None)
    return assemble(path, views, skeleton, rate)


def _skeleton(path: Path, cameras: Sequence[Landmarks], request: Request) -> Skeleton:
    counts = {each.values.shape[1] for each in cameras if len(each.values)}
    count = max(counts, default=len(request.skeleton) if request.skeleton else _BODY)
    by_count = {33: "mediapipe_33", 543: "mediapipe_holistic_543", 553: "mediapipe_holistic_553"}
    if request.skeleton is not None and len(request.skeleton) == count:
        return request.skeleton
    if request.skeleton is not None or count not in by_count:
        raise FileError(
            f"{path} has {count} landmarks per person. MediaPipe's body has {_BODY}, with hands and face 543 or 553"
            + (f"; skeleton {request.skeleton.name} has {len(request.skeleton)}." if request.skeleton else ".")
        )
    return shipped_skeleton(by_count[count])


def _view(file: Path, name: str, landmarks: Landmarks, skeleton: Skeleton, request: Request) -> ViewColumns:
    values = landmarks.values
    if len(values) and values.shape[1] < len(skeleton):
        if values.shape[1] != _BODY:
            raise FileError(
                f"{file} has {values.shape[1]} landmarks per person, but other cameras have {len(skeleton)}."
            )
        hands_and_face = np.full((len(values), len(skeleton) - _BODY, 4), np.nan)
        values = np.concatenate([values, hands_and_face], axis=1)
    values = values.reshape(len(values), len(skeleton), 4)
    pixels, depth = values[..., :2], values[..., 2]
    finite = np.abs(pixels[np.isfinite(pixels)])
    if not len(finite) or np.quantile(finite, 0.95) <= _MAX_FRACTION:
        size = landmarks.size_px or request.image_size_px
        if size is None and len(finite):
            raise FileError(
                f"{file} has landmarks in fractions of the image size but does not specify that size. Add "
                '`image_size=(width, height)`, or "width" and "height" to the file.'
            )
        pixels, depth = pixels * np.asarray(size or (1, 1)), depth * (size or (1, 1))[0]
    missing = ~np.isfinite(pixels).all(axis=-1)
    keypoints = np.concatenate([pixels, values[..., 3:]], axis=-1)
    keypoints[missing] = np.nan
    return ViewColumns(
        name=name,
        recorded=landmarks.recorded,
        frame_of_row=landmarks.frame_of_row,
        keypoints=keypoints,
        track_ids=np.full(len(values), -1, dtype=np.int64),
        depth=np.where(missing | ~np.isfinite(depth), np.nan, depth),
        time_s=landmarks.time_s,
    )


def _read_json(file: Path) -> Landmarks:
    content = decode(file, dict[str, Any] | list[Any])
    header: Mapping[str, Any] = content if isinstance(content, dict) else {}
    frames = header.get("frames", []) if isinstance(content, dict) else content
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise FileError(f"{file}: expected a list of frames with {_POSE[0]}.")
    numbers, times, rows, of_row = [], [], [], []
    for i, frame in enumerate(frames):
        number = checked_integer(frame.get("frame", frame.get("frame_index", i)), "the frame", f"{file}, frame {i}")
        numbers.append(number)
        times.append(_millis(frame.get("timestamp_ms")) * 1e-3)
        people = _people(frame, f"{file}, frame {number}")
        rows += people
        of_row += [number] * len(people)
    longest = max((len(row) for row in rows), default=_BODY)
    values = [np.concatenate([row, np.full((longest - len(row), 4), np.nan)]) for row in rows]
    rate = header.get("fps")
    landmarks = Landmarks(
        recorded=np.array(numbers, dtype=np.int64),
        frame_of_row=np.array(of_row, dtype=np.int64),
        values=np.array(values).reshape(len(values), longest, 4),
        size_px=_size(header),
        rate_hz=float(rate) if isinstance(rate, int | float) and 0 < rate < 1e6 else None,
    )
    return replace(landmarks, time_s=np.array(times)) if np.isfinite(times).all() and len(times) else landmarks


def _millis(value: Any) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else np.nan


def _size(header: Mapping[str, Any]) -> tuple[int, int] | None:
    for names in (("width", "height"), ("image_width", "image_height")):
        size = [header.get(name) for name in names]
        if all(isinstance(n, int | float) and not isinstance(n, bool) and 0 < n < 1e6 for n in size):
            return int(size[0]), int(size[1])  # type: ignore[arg-type]
    return None


def _people(frame: Mapping[str, Any], where: str) -> list[np.ndarray]:
    """Return the landmarks of each person in a frame, each of shape (landmark, 4)."""
    bodies = _first(frame, _POSE)
    if isinstance(bodies, list) and bodies and isinstance(bodies[0], list):
        people = [_points(person, where) for person in bodies]
    else:
        people = [_points(bodies, where)] if bodies else []
    parts = [_first(frame, names) for names in (_MESH, _LEFT, _RIGHT)]
    if any(parts) and len(people) <= 1:
        mesh, left, right = (_points(part[0] if _nested(part) else part, where) if part else None for part in parts)
        people = [_whole_body(people[0] if people else None, mesh, left, right, where)]
    for person in people:
        if len(person) not in (_BODY, 543, 553):
            raise FileError(f"{where}: expected the {_BODY} landmarks of a body, got {len(person)}.")
    return people


def _nested(part: Any) -> bool:
    return isinstance(part, list) and isinstance(part[0], list)


def _first(frame: Mapping[str, Any], names: Sequence[str]) -> Any:
    return next((frame[name] for name in names if frame.get(name)), None)


def _points(landmarks: Any, where: str) -> np.ndarray:
    if isinstance(landmarks, dict):
        landmarks = landmarks.get("landmark")
    if not isinstance(landmarks, list) or not all(isinstance(point, dict) for point in landmarks):
        raise FileError(f"{where}: expected landmarks as a list of x, y, z, visibility.")
    try:
        rows = [[point["x"], point["y"], point.get("z"), point.get("visibility")] for point in landmarks]
        return np.array(rows, dtype=np.float64).reshape(-1, 4)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise FileError(f"{where}: a landmark lacks a numeric x or y.") from None


@dataclass(frozen=True)
class _Part:
    name: str
    count: int


def _whole_body(
    body: np.ndarray | None, mesh: np.ndarray | None, left: np.ndarray | None, right: np.ndarray | None, where: str
) -> np.ndarray:
    """Return body, face and hands in the order of the skeleton: 543 landmarks without irises, 553 with them."""
    irises = mesh is not None and len(mesh) == _FACE_WITH_IRISES
    face, hands = (_Part("face", _FACE_WITH_IRISES if irises else _FACE), _Part("hand", _HAND))
    pieces = [
        _filled(body, _Part("body", _BODY), where),
        _filled(mesh, face, where),
        _filled(left, hands, where),
        _filled(right, hands, where),
    ]
    order = (0, 3, 2, 1) if irises else (0, 1, 2, 3)
    return np.concatenate([pieces[i] for i in order])


def _filled(points: np.ndarray | None, part: _Part, where: str) -> np.ndarray:
    if points is None:
        return np.full((part.count, 4), np.nan)
    if len(points) != part.count:
        raise FileError(f"{where}: expected {part.count} landmarks of a {part.name}, got {len(points)}.")
    return points


FORMAT = KeypointFormat(
    name="mediapipe",
    files="one *.json or *.csv of landmarks per camera",
    conventions="fractions of the image size (`image_size` if the file does not state it) or px; depth in px",
    matches=matches,
    read=read,
    camera_files=files_of,
)
