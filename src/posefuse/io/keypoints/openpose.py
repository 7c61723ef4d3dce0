"""OpenPose JSON: one folder per camera, one file per frame, ``people[].pose_keypoints_2d`` as x, y, confidence.

Hands and faces are separate lists (see ``openpose_parts``); with BODY_25 they make openpose_137. 0, 0, 0 is a missing
keypoint. A person ``{}`` was not found in this view by the association of Pose2Sim: in a folder with such people, the
index in the list is the identity of the person. Otherwise it is ``person_id``, unless that is -1.
"""

import heapq
import json
import os
import re
from array import array
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import natural_key
from posefuse.io.keypoints import openpose_writing
from posefuse.io.keypoints.columns import ViewColumns, assemble
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.infer_skeleton import infer_skeleton, no_skeleton, wrong_skeleton
from posefuse.io.keypoints.openpose_parts import (
    BODY,
    N_BODY,
    N_WHOLE,
    WHOLE,
    PartRows,
    describe_person,
    has_parts,
    join_parts,
    missing_parts,
)
from posefuse.io.keypoints.people import beginning
from posefuse.io.keypoints.pose2sim_config import find_settings
from posefuse.io.keypoints.request import Request
from posefuse.io.read_ahead import contents
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton


class _Person(msgspec.Struct):
    pose_keypoints_2d: list[float] = []
    person_id: list[int] | int = -1
    hand_left_keypoints_2d: list[float] = []
    hand_right_keypoints_2d: list[float] = []
    face_keypoints_2d: list[float] = []


class _Frame(msgspec.Struct):
    people: list[_Person]


_decoder = msgspec.json.Decoder(_Frame)
_NUMBER = re.compile(r"(\d{1,12})\D*$")
_PROGRESS_FILES = 100
_INSPECTED = 3


def matches(path: Path) -> bool:
    """Return whether a folder contains OpenPose files of one camera, or one folder of them per camera."""
    if not path.is_dir():
        return False
    return any(b'"people"' in start for start in first_bytes(path))


def first_bytes(path: Path) -> Iterator[bytes]:
    """Yield the first bytes of the first files of the first cameras. Several, because some may be damaged."""
    for folder in camera_folders(path)[:_INSPECTED]:
        for name in heapq.nsmallest(_INSPECTED, frame_names(folder)):
            yield beginning(folder / name)


def camera_folders(path: Path) -> list[Path]:
    """Return the folders of the cameras in natural order, or the folder itself if it is that of one camera."""
    with os.scandir(path) as entries:
        inside = [path / entry.name for entry in entries if entry.is_dir() and _has_frames(path / entry.name)]
    if inside:
        return sorted(inside, key=lambda entry: natural_key(entry.name))
    return [path] if _has_frames(path) else []


def _has_frames(folder: Path) -> bool:
    if (folder / "reconstruction.nc").exists():
        return False
    with os.scandir(folder) as entries:
        return any(entry.name.endswith(".json") and entry.is_file() for entry in entries)


def frame_names(folder: Path) -> list[str]:
    """Return the names of the JSON files of a camera. A result folder, which contains other JSON files, has none.

    Checking each file separately, or creating a path object for it, would take as long as reading it.
    """
    if (folder / "reconstruction.nc").exists():
        return []
    with os.scandir(folder) as entries:
        return [entry.name for entry in entries if entry.name.endswith(".json") and entry.is_file()]


def frame_files(folder: Path) -> list[Path]:
    """Return the JSON files of a camera in natural order."""
    return [folder / name for name in sorted(frame_names(folder), key=natural_key)]


def read(path: Path, request: Request) -> Detections:
    """Read all cameras. ``Config.toml`` of Pose2Sim provides the rate and skeleton if the request does not.

    Raises:
        FileError: If a file is truncated, is not from OpenPose, or its name has no frame number.
        SkeletonError: If the number of keypoints does not identify a skeleton.
    """
    folders = camera_folders(path)
    settings = find_settings(path)
    files = {folder: frame_names(folder) for folder in folders}
    request.progress.start("reading keypoints", sum(map(len, files.values())))
    read_views = [_read_view(folder, files[folder], request) for folder in folders]
    request.progress.finish()
    requested = request.skeleton or settings.skeleton
    people_lists, notes = _with_parts(read_views, requested)
    views = _with_track_ids(people_lists)
    n_keypoints = _common_length(path, views)
    skeleton = requested
    if skeleton is None and n_keypoints:
        skeleton, inference_notes = _inferred(n_keypoints, views, str(path))
        notes = (*inference_notes, *notes)
    if skeleton is None:
        raise no_skeleton(path)
    if n_keypoints and n_keypoints != len(skeleton):
        raise wrong_skeleton(path, n_keypoints, skeleton)
    views = [view if len(view.keypoints) else _without_people(view, len(skeleton)) for view in views]
    if request.rate_hz is None and settings.rate_hz is not None:
        notes = (*notes, f"Frame rate {settings.rate_hz:g} Hz read from Config.toml.")
    return assemble(path, views, skeleton, request.rate_hz or settings.rate_hz, notes)


@dataclass(frozen=True)
class _PeopleList:
    """The people of one camera before identities are resolved.

    Attributes:
        view: The people, with ``person_id`` as track ids.
        place: Index of each person in the list of its file.
        has_empty: Whether a list contains an empty person; if so, ``place`` identifies the person.
        parts: Hands and faces.
    """

    view: ViewColumns
    place: np.ndarray
    has_empty: bool
    parts: PartRows


def _with_parts(
    people_lists: list[_PeopleList], requested: Skeleton | None
) -> tuple[list[_PeopleList], tuple[str, ...]]:
    """Return the people with hands and faces if the files and the skeleton have them, and notes."""
    has_any = any(people.parts.any for people in people_lists)
    body, inference_notes = _body_of(people_lists) if has_any and requested is None else (None, ())
    if not (has_parts(requested) if requested is not None else body == BODY):
        note = "Hands and faces in these files are not read. Use `skeleton='openpose_137'` to read them with BODY_25."
        return people_lists, (note,) if has_any else ()
    n_people = sum(len(people.view.keypoints) for people in people_lists)
    missing = missing_parts([people.parts for people in people_lists], n_people) if n_people else ()
    return [replace(people, view=_whole(people)) for people in people_lists], (*inference_notes, *missing)


def _body_of(people_lists: list[_PeopleList]) -> tuple[str | None, tuple[str, ...]]:
    """Return the name of the body skeleton with 25 keypoints, or None for another size, and notes."""
    detected = [each.view.keypoints[..., :2] for each in people_lists if len(each.view.keypoints)]
    if {people.shape[1] for people in detected} != {N_BODY}:
        return None, ()
    skeleton, notes = infer_skeleton(N_BODY, np.concatenate(detected), "The body in these files")
    return skeleton.name, notes


def _whole(people: _PeopleList) -> ViewColumns:
    body = people.view.keypoints
    if body.shape[1] == N_WHOLE:
        return people.view
    if len(body) and body.shape[1] != N_BODY:
        raise FileError(
            f"{people.view.name} has {body.shape[1]} body keypoints, but skeleton {WHOLE} has {N_BODY}. Choose "
            "another "
            "with `skeleton`, or omit it to infer the skeleton from the files."
        )
    keypoints = join_parts(body.reshape(-1, N_BODY, 3), people.parts)
    return replace(people.view, keypoints=_without_missing(keypoints))


def _inferred(n_keypoints: int, views: list[ViewColumns], path: str) -> tuple[Skeleton, tuple[str, ...]]:
    people = np.concatenate([view.keypoints[..., :2] for view in views if len(view.keypoints)])
    return infer_skeleton(n_keypoints, people, path)


def _with_track_ids(people_lists: list[_PeopleList]) -> list[ViewColumns]:
    by_place = any(people.has_empty for people in people_lists)
    return [replace(p.view, track_ids=p.place) if by_place else p.view for p in people_lists]


def _read_view(folder: Path, names: list[str], request: Request) -> _PeopleList:
    # All numbers of a view in one flat array: lists of Python floats would take four times the memory.
    numbers, people, parts = array("d"), _Rows([], [], [], []), PartRows()
    numbered = sorted((_frame_number(folder, name), name) for name in names)
    for before, after in pairwise(numbered):
        if before[0] == after[0]:
            raise FileError(f"{folder} has two files for frame {after[0]}.")
    has_empty = False
    with closing(contents(folder, [name for _, name in numbered])) as data:
        for done, ((frame, name), content) in enumerate(zip(numbered, data, strict=True), start=1):
            for place, person in enumerate(_decode(folder, name, content).people):
                if not person.pose_keypoints_2d:
                    has_empty = True
                    continue
                where = folder, name, place
                length = _length(person, where)
                numbers.extend(person.pose_keypoints_2d)
                parts.add(len(people.frames), _parts_of(person), where)
                person_id = person.person_id if isinstance(person.person_id, int) else (person.person_id or [-1])[0]
                people.add(frame, place, person_id, length)
            if done % _PROGRESS_FILES == 0:
                request.progress.advance(_PROGRESS_FILES)
    request.progress.advance(len(numbered) % _PROGRESS_FILES)
    return _PeopleList(
        _columns(folder, np.array([frame for frame, _ in numbered], dtype=np.int64), people, numbers),
        np.array(people.places, dtype=np.int64),
        has_empty,
        parts,
    )


def _length(person: _Person, where: tuple[Path, str, int]) -> int:
    n_numbers = len(person.pose_keypoints_2d)
    if n_numbers % 3:
        raise FileError(
            f"{describe_person(where)}: pose_keypoints_2d has {n_numbers} numbers; expected x, y, confidence for each "
            "keypoint."
        )
    return n_numbers // 3


def _parts_of(person: _Person) -> tuple[list[float], list[float], list[float]]:
    return person.hand_left_keypoints_2d, person.hand_right_keypoints_2d, person.face_keypoints_2d


@dataclass(frozen=True)
class _Rows:
    """Frame, index in the list, ``person_id`` and number of keypoints of each person."""

    frames: list[int]
    places: list[int]
    person_ids: list[int]
    lengths: list[int]

    def add(self, frame: int, place: int, person_id: int, length: int) -> None:
        self.frames.append(frame)
        self.places.append(place)
        self.person_ids.append(person_id)
        self.lengths.append(length)


def _columns(folder: Path, recorded: np.ndarray, people: _Rows, numbers: "array[float]") -> ViewColumns:
    if len(set(people.lengths)) > 1:
        common = Counter(people.lengths).most_common(1)[0][0]
        other = next(i for i, length in enumerate(people.lengths) if length != common)
        raise FileError(
            f"{folder}, frame {people.frames[other]}: person {people.places[other]} has {people.lengths[other]} "
            f"keypoints, but others have {common}. All people must have the same keypoints. Is the file truncated?"
        )
    keypoints = np.array(numbers, dtype=np.float64).reshape(len(people.frames), next(iter(people.lengths), 0), 3)
    return ViewColumns(
        name=folder.name,
        recorded=recorded,
        frame_of_row=np.array(people.frames, dtype=np.int64),
        keypoints=_without_missing(keypoints),
        track_ids=np.array(people.person_ids, dtype=np.int64),
    )


def _without_missing(keypoints: np.ndarray) -> np.ndarray:
    missing = (keypoints[..., 2] == 0) | ((keypoints[..., 0] == 0) & (keypoints[..., 1] == 0))
    keypoints[missing] = np.nan
    return keypoints


def _decode(folder: Path, name: str, data: bytes) -> _Frame:
    file = os.path.join(folder, name)
    try:
        return _decoder.decode(data)
    except msgspec.ValidationError as error:
        raise FileError(f"{file} is not an OpenPose file: {error}.") from None
    except msgspec.DecodeError as error:
        # Some programs write NaN, which is not valid JSON but unambiguous.
        try:
            return msgspec.convert(json.loads(data), _Frame)
        except (json.JSONDecodeError, UnicodeDecodeError):
            raise FileError(
                f"{file} is not complete JSON ({len(data)} bytes): {error}. Is the file truncated?"
            ) from None
        except msgspec.ValidationError as invalid:
            raise FileError(f"{file} is not an OpenPose file: {invalid}.") from None


def _frame_number(folder: Path, name: str) -> int:
    match = _NUMBER.search(name.removesuffix(".json").removesuffix("_keypoints"))
    if match is None:
        raise FileError(
            f"{folder / name}: expected a frame number in the name, as in camera_000000000012_keypoints.json."
        )
    return int(match.group(1))


def _common_length(path: Path, views: list[ViewColumns]) -> int:
    lengths = {view.keypoints.shape[1]: view.name for view in views if len(view.keypoints)}
    if len(lengths) > 1:
        parts = ", ".join(f"{name}: {n}" for n, name in sorted(lengths.items()))
        raise FileError(
            f"{path}: views have different numbers of keypoints ({parts}). All must have the same skeleton."
        )
    return next(iter(lengths), 0)


def _without_people(view: ViewColumns, n_keypoints: int) -> ViewColumns:
    empty = np.empty(0, dtype=np.int64)
    return ViewColumns(view.name, view.recorded, empty, np.empty((0, n_keypoints, 3)), empty)


def write(detections: Detections, path: Path) -> None:
    """Write one folder per camera. See ``openpose_writing``.

    Raises:
        FileError: If the folder contains other files, or a name or frame number cannot be written.
    """
    openpose_writing.write(detections, path)


def lost(detections: Detections, path: Path) -> tuple[str, ...]:
    """Return what of the detections is lost in the files."""
    return openpose_writing.lost(detections)


FORMAT = KeypointFormat(
    name="openpose",
    files=("one folder per camera, one *.json per frame (also Pose2Sim, and AlphaPose in the OpenPose layout)"),
    conventions=("px; x y confidence, 0 0 0 is missing; hands and faces beside BODY_25; no frame rate: `rate_hz`"),
    recognized_by='one folder per camera with numbered JSON files that contain "people"',
    matches=matches,
    read=read,
    write=write,
    lost=lost,
)
