"""JSON of MMPose, RTMPose and rtmlib, one file per camera: ``instance_info`` with ``meta_info``, or its bare list.

Each frame has ``frame_id`` (MMPose counts from 1) and ``instances`` with ``keypoints`` (x, y) and
``keypoint_scores``; ``track_id`` or ``instance_id`` is the track. Frames without people have an empty list. If
``meta_info`` names the keypoints (``keypoint_id2name``), the names identify the skeleton, otherwise their number does.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from posefuse.io.keypoints.camera_files import FileKind, all_camera_files, read_views, valid_camera_files
from posefuse.io.keypoints.columns import ViewColumns
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.people import Person, beginning, checked_integer, decode, detections_of, joined, view_columns
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.from_names import skeleton_named
from posefuse.skeleton.skeletons import Skeleton


class _Instance(msgspec.Struct):
    keypoints: list[list[float]]
    keypoint_scores: list[float]
    track_id: int | None = None
    instance_id: int | None = None


class _Frame(msgspec.Struct):
    frame_id: int
    instances: list[_Instance]


class _File(msgspec.Struct):
    instance_info: list[_Frame]
    meta_info: Any = None


def matches(path: Path) -> bool:
    """Return whether a path is a file in this format, or a folder or folders with one per camera."""
    return bool(valid_camera_files(path, _KIND))


def files_of(path: Path) -> list[Path]:
    """Return the files, including damaged ones, because a camera must not be dropped silently."""
    return all_camera_files(path, _KIND)


def _is_one(file: Path) -> bool:
    start = beginning(file, 200_000)
    return (start.startswith(b'[{"frame_id"') or b'"instance_info"' in start) and b'"instances"' in start


def _is_similar(file: Path) -> bool:
    """Return whether a file is in this format without frames, or with broken frames."""
    start = beginning(file, 200_000)
    return start == b"[]" or b'"instance_info"' in start or b'"instances"' in start


_KIND = FileKind((".json",), _is_one, _is_similar)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: If a file is truncated or in another format, or views have different keypoints.
        SkeletonError: If neither the names nor the number of keypoints identify a skeleton.
    """
    named: list[tuple[str, ...]] = []

    def read_one(file: Path, name: str) -> ViewColumns:
        if beginning(file, 16).startswith(b"["):
            return _view(file, name, decode(file, list[_Frame]))
        content: _File = decode(file, _File)
        named.append(_names(content.meta_info))
        return _view(file, name, content.instance_info)

    views = read_views(path, _KIND, request, read_one)
    return detections_of(path, views, replace(request, skeleton=request.skeleton or _skeleton(views, named)))


def _names(meta_info: Any) -> tuple[str, ...]:
    """Return the keypoint names of a file in order, or none if it has no names."""
    names = meta_info.get("keypoint_id2name") if isinstance(meta_info, dict) else None
    if not isinstance(names, dict):
        return ()
    ordered = [names.get(str(i)) for i in range(len(names))]
    return tuple(name for name in ordered if isinstance(name, str)) if None not in ordered else ()


def _skeleton(views: Sequence[ViewColumns], named: Sequence[tuple[str, ...]]) -> Skeleton | None:
    """Return the skeleton with the files' names; None unless all files have the same names, one per keypoint."""
    count = next((view.keypoints.shape[1] for view in views if len(view.keypoints)), 0)
    names = named[0] if named and len(named) == len(views) else ()
    if not names or set(named) != {names} or len(set(names)) != len(names) or count not in (0, len(names)):
        return None
    return skeleton_named("mmpose", names)


def _view(file: Path, name: str, frames: Sequence[_Frame]) -> ViewColumns:
    where = str(file)
    people = [
        Person(frame.frame_id, joined(i.keypoints, i.keypoint_scores, where, frame.frame_id), _track(i))
        for frame in frames
        for i in frame.instances
    ]
    return view_columns(name, {checked_integer(frame.frame_id, "frame_id", where) for frame in frames}, people, where)


def _track(instance: _Instance) -> int:
    ids = [number for number in (instance.track_id, instance.instance_id) if number is not None]
    return ids[0] if ids and abs(ids[0]) < 2**40 else -1


FORMAT = KeypointFormat(
    name="mmpose",
    files="one *.json with instances per camera (also RTMPose, rtmlib)",
    conventions="px; frame numbers as stored, from 1 or 0; no frame rate: `rate_hz`",
    recognized_by='JSON with the "instances" of each frame',
    matches=matches,
    read=read,
    camera_files=files_of,
)
