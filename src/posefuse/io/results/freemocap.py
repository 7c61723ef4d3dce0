"""FreeMoCap's arrays: a folder ``output_data`` with its names and shapes; one person; millimeters, as FreeMoCap's.

``raw_data/<tracker>_3dData_numFrames_numTrackedPoints_spatialXYZ.npy`` (frame, keypoint, 3) is the layer ``measured``
where there is one; ``..._reprojectionError.npy`` (frame, keypoint) and, by camera, (camera, frame, keypoint) are its
errors; ``<tracker>_skeleton_3d.npy`` is the layer asked for, and of MediaPipe's skeletons it is cut into
``<tracker>_body_3d_xyz``, ``_right_hand_``, ``_left_hand_`` and ``_face_``, ``.npy`` and ``.csv``. The tracker is
``mediapipe``, ``rtmpose`` (COCO-WholeBody) or the skeleton's name. Rows are frames without gaps from the first one on.

Beside that, in ``output_data/posefuse``: ``covariance_m2.npy``, ``status.npy``, ``source.npy``, ``view_status.npy``,
``view_error_px.npy``, ``reprojection_error_px.npy`` of the layer asked for, ``frame_number.npy``, ``time_s.npy``; and
``posefuse.json``, which names everything.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from posefuse.arrays import ArraySource
from posefuse.errors import FileError, ResultError
from posefuse.io.files import must_exist, read_text, reading, replacing_folder
from posefuse.io.results import csv
from posefuse.io.results.format import ResultFormat
from posefuse.io.results.names import safe_names
from posefuse.io.results.rows import blocks, rows_of
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.stored_points import StoredPoints

MM_PER_M = 1000.0
HEAD = "posefuse.json"
_OURS = "posefuse"
_FOLDER = "output_data"
_OWNED = (f"{_FOLDER}/{HEAD}", f"{_FOLDER}/{_OURS}/*.npy", f"{_FOLDER}/raw_data/*_3dData_*.npy", f"{_FOLDER}/*_3d*")
_DATA = "3dData_numFrames_numTrackedPoints"
_BY_CAMERA = "3dData_numCams_numFrames_numTrackedPoints"
_TRACKERS = {"coco_wholebody_133": "rtmpose"}
_BODY, _HAND = 33, 21
_FIELDS = ("covariance_m2", "status", "source", "reprojection_error_px", "view_status", "view_error_px")
_ABSENT = {"status": -1, "source": 0, "view_status": -1}


@dataclass(frozen=True)
class Array:
    """An array that is written by ranges of frames.

    Attributes:
        name: its file's, under ``output_data``, without the ending.
        shape: of the whole.
        dtype: of its numbers.
        rows: gives its consecutive parts, which flattened and joined are the whole.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype
    rows: Callable[[], Iterator[np.ndarray]]


def tracker_of(skeleton: str) -> str:
    """What FreeMoCap would call who tracked such a skeleton."""
    if skeleton.startswith("mediapipe"):
        return "mediapipe"
    return _TRACKERS.get(skeleton) or safe_names([skeleton])[0]


def write(result: Reconstruction, person: str, path: Path, layer: LayerName) -> None:
    """Write one person into ``path/output_data``.

    Raises:
        ResultError: if there are no frames, or the result comes from a single camera.
        FileError: if the folder holds something else.
    """
    arrays = arrays_of(result, person, layer)
    places, _ = rows_of(result, "freemocap")
    with replacing_folder(path, f"{_FOLDER}/{HEAD}", _OWNED) as staging:
        for array in arrays:
            _write_array(staging / _FOLDER / f"{array.name}.npy", array)
        points = result.layers[layer].points_m
        for part, titles, columns in parts_of(result.skeleton.keypoints, result.skeleton.name):
            name = f"{tracker_of(result.skeleton.name)}_{part}_3d_xyz.csv"
            picked = _points(points, result.person_ids.index(person), columns)
            tables = (
                {f"{title}_{axis}": block[:, k, i] for k, title in enumerate(titles) for i, axis in enumerate("xyz")}
                for block in blocks(picked, places)
            )
            csv.write_plain(tables, staging / _FOLDER / name)
        (staging / _FOLDER / HEAD).write_text(head_of(result, person, layer), "utf-8")


def _write_array(path: Path, array: Array) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        write_npy(file, array)


def write_npy(file: object, array: Array) -> None:
    """Write an array as a .npy file's bytes."""
    described = {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape}
    np.lib.format.write_array_header_1_0(file, described)  # type: ignore[arg-type]
    for block in array.rows():
        file.write(np.ascontiguousarray(block).tobytes())  # type: ignore[attr-defined]


def head_of(result: Reconstruction, person: str, layer: LayerName) -> str:
    """What the arrays are, as JSON."""
    said = {
        "version": 1,
        "person": person,
        "layer": layer,
        "raw_layer": _raw(result, layer),
        "tracker": tracker_of(result.skeleton.name),
        "skeleton": result.skeleton.name,
        "keypoints": result.skeleton.keypoints,
        "cameras": result.rig.names,
        "rate_hz": result.rate_hz,
        "units": {"points": "mm", "covariance": "m2", "errors": "px", "time": "s"},
        "status": {code.label: code.value for code in PointStatus},
        "source": {code.name.lower(): code.value for code in Source},
        "view_status": {code.label: code.value for code in ViewStatus},
    }
    return json.dumps(said, indent=1)


def _raw(result: Reconstruction, layer: LayerName) -> LayerName:
    return "measured" if "measured" in result.layers else layer


def parts_of(keypoints: tuple[str, ...], skeleton: str) -> list[tuple[str, list[str], list[int]]]:
    """FreeMoCap's parts of a skeleton: name, names of its points in CSV, and places of its keypoints."""
    everything = list(range(len(keypoints)))
    if not skeleton.startswith("mediapipe") or len(keypoints) < _BODY:
        return [("body", [f"body_{name}" for name in keypoints], everything)]
    body, rest = everything[:_BODY], everything[_BODY:]
    found = [("body", [f"body_{keypoints[i]}" for i in body], body)]
    for side in ("right", "left"):
        start = keypoints.index(f"{side}_hand_root") if f"{side}_hand_root" in keypoints else None
        if start is not None:
            hand = everything[start : start + _HAND]
            rest = [i for i in rest if i not in hand]
            found.append((f"{side}_hand", [f"{side}_hand_{i:04d}" for i in range(len(hand))], hand))
    if rest:
        found.append(("face", [f"face_{i:04d}" for i in range(len(rest))], rest))
    return found


class _Picked:
    """An array of one person of some keypoints, read by ranges."""

    def __init__(self, source: ArraySource, person: int, columns: list[int] | None, scale: float) -> None:
        self._source, self._person, self._columns, self._scale = source, person, columns, scale
        keypoints = source.shape[2] if columns is None else len(columns)
        self.shape = (source.shape[0], keypoints, *source.shape[3:])
        self.dtype = np.dtype(source.dtype)

    def __getitem__(self, key: slice) -> np.ndarray:
        values = np.asarray(self._source[key])[:, self._person]
        values = values if self._columns is None else values[:, self._columns]
        return values if self._scale == 1.0 else values * self._scale


def _points(source: ArraySource, person: int, columns: list[int] | None = None) -> ArraySource:
    return _Picked(source, person, columns, MM_PER_M)


def arrays_of(result: Reconstruction, person: str, layer: LayerName) -> list[Array]:
    """All arrays of one person.

    Raises:
        ResultError: if there are no frames, or the result comes from a single camera.
    """
    if result.unit != "m":
        raise ResultError(
            f"FreeMoCap's arrays are in mm; this result is in {result.unit} (image plane of a single camera)."
        )
    places, n_rows = rows_of(result, "freemocap")
    index, tracker = result.person_ids.index(person), tracker_of(result.skeleton.name)
    raw, asked = result.layers[_raw(result, layer)], result.layers[layer]

    def rows(name: str, source: ArraySource, missing: float = np.nan) -> Array:
        shape = (n_rows, *source.shape[1:])
        return Array(name, shape, np.dtype(source.dtype), lambda: blocks(source, places, missing))

    def of_person(source: ArraySource) -> ArraySource:
        return _Picked(source, index, None, 1.0)

    found = [
        rows(f"raw_data/{tracker}_{_DATA}_spatialXYZ", _points(raw.points_m, index)),
        rows(f"raw_data/{tracker}_{_DATA}_reprojectionError", of_person(raw.reprojection_error_px)),
        _by_camera(f"raw_data/{tracker}_{_BY_CAMERA}_reprojectionError", of_person(raw.view_error_px), places, n_rows),
        rows(f"{tracker}_skeleton_3d", _points(asked.points_m, index)),
    ]
    for part, _, columns in parts_of(result.skeleton.keypoints, result.skeleton.name):
        found.append(rows(f"{tracker}_{part}_3d_xyz", _points(asked.points_m, index, columns)))
    for name in _FIELDS:
        found.append(rows(f"{_OURS}/{name}", of_person(getattr(asked, name)), _ABSENT.get(name, np.nan)))
    for name, values in (("frame_number", result.frame_numbers), ("time_s", result.time_s)):
        found.append(Array(f"{_OURS}/{name}", values.shape, values.dtype, lambda values=values: iter([values])))
    return found


def _by_camera(name: str, source: ArraySource, places: np.ndarray, n_rows: int) -> Array:
    """Camera by camera, as FreeMoCap's axes are: the frames are read once for each."""
    keypoints, views = source.shape[1:]

    def rows() -> Iterator[np.ndarray]:
        for view in range(views):
            yield from (block[..., view].astype(np.float64) for block in blocks(source, places))

    return Array(name, (views, n_rows, keypoints), np.dtype(np.float64), rows)


def matches(path: Path) -> bool:
    """Return whether a folder was written by posefuse."""
    return (path / _FOLDER / HEAD).is_file()


def read(path: Path) -> StoredPoints:
    """Read a folder that we wrote.

    Raises:
        FileError: if it is none, or an array is broken.
    """
    head_file = must_exist(path / _FOLDER / HEAD, "FreeMoCap arrays of posefuse's")

    def array(name: str) -> np.ndarray:
        file = must_exist(path / _FOLDER / f"{name}.npy", "array")
        with reading(file, ".npy file"):
            return np.load(file, allow_pickle=False)

    return points_of(head_file, read_text(head_file), array)


def points_of(path: Path, head: str, array: Callable[[str], np.ndarray]) -> StoredPoints:
    """The layer asked for, of the arrays by name.

    Raises:
        FileError: if an array is not there, or they do not fit each other.
    """
    with reading(path, "head of FreeMoCap arrays"):
        said = json.loads(head)
        frame_numbers = array(f"{_OURS}/frame_number")
        places = frame_numbers - frame_numbers[:1]
        values = {name: array(f"{_OURS}/{name}")[places][:, None] for name in _FIELDS}
        points = array(f"{said['tracker']}_skeleton_3d")
        if len(places) == 0 or places[-1] + 1 != len(points):
            raise FileError(f"{path}: {len(points)} rows of points do not fit {len(frame_numbers)} frame numbers.")
        return StoredPoints(
            keypoints=tuple(said["keypoints"]),
            person_ids=(said["person"],),
            frame_numbers=frame_numbers,
            time_s=array(f"{_OURS}/time_s"),
            points_m=points[places][:, None] / MM_PER_M,
            unit="m",
            layer=said["layer"],
            rate_hz=said["rate_hz"],
            view_names=tuple(said["cameras"]),
            **values,
        )


FORMAT = ResultFormat(
    name="freemocap",
    files="one folder per person with output_data/*.npy, *.csv",
    conventions=(
        "FreeMoCap's names and shapes; mm, world axes; one row per frame; all other fields in output_data/posefuse"
    ),
    additional_name="freemocap",
    is_folder=True,
    holds_measured_layer=True,
    matches=matches,
    read=read,
    write_person=write,
)
