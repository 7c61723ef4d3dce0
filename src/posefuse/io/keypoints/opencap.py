"""OpenCap's 2D keypoints, one file per camera and trial.

``Videos/<camera>/OutputPkl_<detector>/<trial>/<trial>_rotated_pp.pkl`` is where OpenCap writes them,
``Videos/<camera>/OutputPkl/<trial>_keypoints.pkl`` where the exports of its web application have them. A file is a list
of frames, each a list of people with ``pose_keypoints_2d``: x, y, confidence of the BODY_25 keypoints, 0 0 0 if
missing, from OpenPose or from MMPose in that order. ``person_id`` is the index in the list, not an identity. The input
is the folder of the cameras, or the file of one camera: those of the other cameras of the trial are read, too. Pickles
can execute code; only lists, dicts, strings and numbers are unpickled, and other content is refused.
"""

from pathlib import Path
from typing import Any

from posefuse.errors import FileError
from posefuse.io.files import check_unpacked_size, natural_key, reading
from posefuse.io.keypoints.columns import ViewColumns
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.people import Person, detections_of, view_columns
from posefuse.io.keypoints.request import Request
from posefuse.io.pickles import load_plain
from posefuse.model.detections import Detections

_FOLDERS = "OutputPkl"
_ENDING, _DOWNLOADED = "_pp.pkl", "_keypoints.pkl"
_PERSON_BYTES = 600


def matches(path: Path) -> bool:
    """Return whether a path is a file in this format, or a folder with folders of cameras that contain some."""
    return bool(trials_in(path))


def trials_in(path: Path) -> list[Path]:
    """Return the file of the first camera for each trial and detector, or the path itself if it is a file."""
    if path.is_file():
        return [path] if _is_one(path) else []
    first: dict[tuple[str, ...], Path] = {}
    for pattern in (f"*/{_FOLDERS}*/*/*{_ENDING}", f"*/{_FOLDERS}*/*{_DOWNLOADED}"):
        for file in _ordered(path.glob(pattern)):
            first.setdefault(_trial(file), file)
    return [file for file in first.values() if _is_one(file)]


def _is_one(file: Path) -> bool:
    return file.name.endswith((_ENDING, _DOWNLOADED)) and _camera(file).name != ""


def _camera(file: Path) -> Path:
    """Return the folder of the camera that a file belongs to; the empty path if it is not in a folder of keypoints."""
    levels = 0 if file.name.endswith(_DOWNLOADED) else 1
    above = list(file.parents)[levels : levels + 2]
    return above[1] if len(above) == 2 and above[0].name.startswith(_FOLDERS) else Path()


def _trial(file: Path) -> tuple[str, ...]:
    """Return the path of a file below the folder of its camera, which all cameras of a trial share."""
    return file.relative_to(_camera(file)).parts


def _ordered(files: Any) -> list[Path]:
    return sorted((file for file in files if file.is_file()), key=lambda file: natural_key(file.as_posix()))


def files_of(path: Path) -> list[Path]:
    """Return the files of a trial, one per camera, or those of all trials in a folder."""
    if path.is_dir():
        return [file for trial in trials_in(path) for file in files_of(trial)]
    return _ordered(_camera(path).parent.glob("/".join(["*", *_trial(path)]))) if _is_one(path) else []


def read(path: Path, request: Request) -> Detections:
    """Read all cameras, named by their folders.

    Raises:
        FileError: If there is not exactly one trial, or a file is truncated, in another format, or contains objects.
        SkeletonError: If the number of keypoints does not identify a skeleton.
    """
    trials = trials_in(path)
    if len(trials) != 1:
        listed = "".join(f"\n  `keypoints={str(trial)!r}`" for trial in trials)
        raise FileError(f"{path} has {len(trials)} OpenCap trials. Specify a file of the one to read:{listed}")
    files = files_of(trials[0])
    request.progress.start("reading keypoints", len(files))
    views = []
    for file in files:
        views.append(_view(file))
        request.progress.advance(1)
    request.progress.finish()
    return detections_of(path, views, request)


def _view(file: Path) -> ViewColumns:
    with reading(file, "pickle of OpenCap keypoints"):
        frames = load_plain(file.read_bytes())
    if not isinstance(frames, list) or not all(isinstance(frame, list) for frame in frames):
        raise FileError(f"{file}: expected a list of frames, each a list of people.")
    # A pickle can refer to one person any number of times.
    check_unpacked_size(file, _PERSON_BYTES * sum(map(len, frames)))
    people = [_person(file, f, one) for f, frame in enumerate(frames) for one in frame]
    return view_columns(_camera(file).name, range(len(frames)), people, str(file))


def _person(file: Path, frame: int, person: Any) -> Person:
    values = person.get("pose_keypoints_2d") if isinstance(person, dict) else None
    if not isinstance(values, list) or not all(isinstance(value, int | float) for value in values):
        raise FileError(
            f"{file}, frame {frame}: a person lacks pose_keypoints_2d, which must be a list of numbers. Is this a raw "
            f"file of the detector? OpenCap files end in {_ENDING} or {_DOWNLOADED} and contain OpenPose keypoints."
        )
    return Person(frame, values)


FORMAT = KeypointFormat(
    name="opencap",
    files="Videos/<camera>/OutputPkl*/<trial>/*_pp.pkl or OutputPkl/*_keypoints.pkl, or the folder of the cameras",
    conventions=(
        "px; x y confidence of BODY_25, 0 0 0 is missing; pickled code is never executed; no frame rate: `rate_hz`"
    ),
    recognized_by="OutputPkl*/<trial>/*_pp.pkl or OutputPkl/*_keypoints.pkl in one folder per camera",
    matches=matches,
    read=read,
    camera_files=files_of,
    trials_in=trials_in,
)
