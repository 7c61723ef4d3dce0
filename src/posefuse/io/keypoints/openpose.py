"""OpenPose's JSON: a folder a camera, a file a frame, ``people[].pose_keypoints_2d`` as x, y, confidence.

0, 0, 0 is a keypoint that was not detected. A person ``{}`` is one that Pose2Sim's association did not find in this
view: where a folder has such, the place in the list is the person's identity. Otherwise ``person_id`` is, unless -1.
"""

import json
import re
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import natural_key
from posefuse.io.keypoints.columns import ViewColumns, assemble
from posefuse.io.keypoints.guess import guess_skeleton
from posefuse.io.keypoints.pose2sim_config import find_settings
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections


class _Person(msgspec.Struct):
    pose_keypoints_2d: list[float] = []
    person_id: list[int] | int = -1


class _Frame(msgspec.Struct):
    people: list[_Person]


_decoder = msgspec.json.Decoder(_Frame)


def matches(path: Path) -> bool:
    """Whether the folder holds OpenPose files, of one camera or of one camera a folder."""
    if not path.is_dir():
        return False
    folder = next((f for f in camera_folders(path)), None)
    first = next(iter(frame_files(folder)), None) if folder else None
    if first is None:
        return False
    with first.open("rb") as file:
        return b'"people"' in file.read(4096)


def camera_folders(path: Path) -> list[Path]:
    """The folders of the cameras, in the order that counts; the folder itself if it is a camera's."""
    inside = [entry for entry in path.iterdir() if entry.is_dir() and frame_files(entry)]
    if inside:
        return sorted(inside, key=lambda entry: natural_key(entry.name))
    return [path] if frame_files(path) else []


def frame_files(folder: Path) -> list[Path]:
    """The JSON files of a camera; a folder of results, which holds other JSON files, is none."""
    if (folder / "reconstruction.nc").exists():
        return []
    found = (entry for entry in folder.iterdir() if entry.suffix == ".json" and entry.is_file())
    return sorted(found, key=lambda entry: natural_key(entry.name))


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: if a file is cut short, is not OpenPose's, or its name has no frame number.
        SkeletonError: if the number of keypoints does not tell the skeleton.
    """
    folders = camera_folders(path)
    settings = find_settings(path)
    files = {folder: frame_files(folder) for folder in folders}
    request.progress.start("reading keypoints", sum(map(len, files.values())))
    people_lists = [_read_view(folder, files[folder], request) for folder in folders]
    request.progress.finish()
    views = _with_track_ids(people_lists)
    n_keypoints = _common_length(path, views)
    people = np.concatenate([view.keypoints[:, :n_keypoints, :2] for view in views])
    skeleton, notes = request.skeleton or settings.skeleton, ()
    if skeleton is None and n_keypoints:
        skeleton, notes = guess_skeleton(n_keypoints, people, str(path))
    if skeleton is None:
        raise FileError(f"{path}: nobody was detected in any view, so nothing tells the skeleton. Add --skeleton.")
    if n_keypoints and n_keypoints != len(skeleton):
        raise FileError(
            f"{path} has {n_keypoints} keypoints a person, skeleton {skeleton.name} has {len(skeleton)}. "
            "Choose another with --skeleton, or leave it out to have it told from the files."
        )
    if not n_keypoints:
        views = [_without_people(view, len(skeleton)) for view in views]
    return assemble(path, views, skeleton, request.rate_hz or settings.rate_hz, notes)


@dataclass(frozen=True)
class _PeopleList:
    """One camera's people; identities not settled yet: by ``place`` in the list if any list has an empty person."""

    view: ViewColumns
    place: np.ndarray
    has_empty: bool


def _with_track_ids(people_lists: list[_PeopleList]) -> list[ViewColumns]:
    by_place = any(people.has_empty for people in people_lists)
    return [replace(p.view, track_ids=p.place) if by_place else p.view for p in people_lists]


def _read_view(folder: Path, files: list[Path], request: Request) -> _PeopleList:
    frames: list[int] = []
    rows: list[tuple[int, int, int, list[float]]] = []
    has_empty = False
    for file in files:
        frame = _frame_number(file)
        frames.append(frame)
        for place, person in enumerate(_decode(file).people):
            if not person.pose_keypoints_2d:
                has_empty = True
                continue
            if len(person.pose_keypoints_2d) % 3:
                raise FileError(
                    f"{file}, person {place}: pose_keypoints_2d holds {len(person.pose_keypoints_2d)} numbers, "
                    "expected x, y, confidence for each keypoint."
                )
            given = person.person_id if isinstance(person.person_id, int) else (person.person_id or [-1])[0]
            rows.append((frame, place, given, person.pose_keypoints_2d))
        request.progress.advance(1)
    if len(set(frames)) != len(frames):
        repeated = next(frame for frame in frames if frames.count(frame) > 1)
        raise FileError(f"{folder} has two files for frame {repeated}.")
    lengths = Counter(len(values) for *_, values in rows)
    if len(lengths) > 1:
        usual = lengths.most_common(1)[0][0]
        frame, place, *_, values = next(row for row in rows if len(row[-1]) != usual)
        raise FileError(
            f"{folder}, frame {frame}: person {place} has {len(values) // 3} keypoints, the others have {usual // 3}; "
            "one recording has one skeleton. Was the file cut short?"
        )
    n_keypoints = next(iter(lengths), 0) // 3
    keypoints = np.array([values for *_, values in rows], dtype=np.float64).reshape(len(rows), n_keypoints, 3)
    missing = (keypoints[..., 2] == 0) | ((keypoints[..., 0] == 0) & (keypoints[..., 1] == 0))
    keypoints[missing] = np.nan
    view = ViewColumns(
        name=folder.name,
        recorded=np.array(frames, dtype=np.int64),
        frame_of_row=np.array([frame for frame, *_ in rows], dtype=np.int64),
        keypoints=keypoints,
        track_ids=np.array([given for _, _, given, _ in rows], dtype=np.int64),
    )
    return _PeopleList(view, np.array([place for _, place, *_ in rows], dtype=np.int64), has_empty)


def _decode(file: Path) -> _Frame:
    data = file.read_bytes()
    try:
        return _decoder.decode(data)
    except msgspec.ValidationError as error:
        raise FileError(f"{file} is not an OpenPose file: {error}.") from None
    except msgspec.DecodeError as error:
        # Some programs write NaN, which is not JSON but is clear enough.
        try:
            return msgspec.convert(json.loads(data), _Frame)
        except (json.JSONDecodeError, UnicodeDecodeError):
            raise FileError(f"{file} is not whole JSON ({len(data)} bytes): {error}. Was it cut short?") from None
        except msgspec.ValidationError as invalid:
            raise FileError(f"{file} is not an OpenPose file: {invalid}.") from None


def _frame_number(file: Path) -> int:
    match = re.search(r"(\d+)\D*$", file.stem.removesuffix("_keypoints"))
    if match is None:
        raise FileError(f"{file}: no frame number in the name, such as in camera_000000000012_keypoints.json.")
    return int(match.group(1))


def _common_length(path: Path, views: list[ViewColumns]) -> int:
    lengths = {view.keypoints.shape[1]: view.name for view in views if len(view.keypoints)}
    if len(lengths) > 1:
        parts = ", ".join(f"{name}: {n}" for n, name in sorted(lengths.items()))
        raise FileError(f"{path}: views have different numbers of keypoints ({parts}); one recording has one skeleton.")
    return next(iter(lengths), 0)


def _without_people(view: ViewColumns, n_keypoints: int) -> ViewColumns:
    nobody = np.empty(0, dtype=np.int64)
    return ViewColumns(view.name, view.recorded, nobody, np.empty((0, n_keypoints, 3)), nobody)
