"""FreeMoCap arrays: one folder per person with FreeMoCap's file names and array shapes; lengths in mm.

All files are in ``output_data``. ``raw_data/<tracker>_3dData_numFrames_numTrackedPoints_spatialXYZ.npy`` (frame,
keypoint, 3) is the layer ``measured`` if the result has it, otherwise the requested layer;
``..._reprojectionError.npy`` has its errors, (frame, keypoint) and, by camera, (camera, frame, keypoint).
``<tracker>_skeleton_3d.npy`` is the requested layer. For MediaPipe skeletons, it is also split into
``<tracker>_body_3d_xyz``, ``_right_hand_``, ``_left_hand_`` and ``_face_``, each as ``.npy`` and ``.csv``. The tracker
is ``mediapipe``, ``rtmpose`` (COCO-WholeBody) or the skeleton's name. There is one row per frame number, without gaps,
starting with the first frame.

``output_data/posefuse`` has the fields for which FreeMoCap has no file: ``covariance_m2.npy``, ``status.npy``,
``source.npy``, ``view_status.npy``, ``view_error_px.npy`` and ``reprojection_error_px.npy`` of the requested layer, and
``frame_number.npy`` and ``time_s.npy``. ``output_data/posefuse.json`` describes the arrays.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from posefuse.arrays import ArraySource
from posefuse.errors import FileError
from posefuse.io.csv_columns import write_csv
from posefuse.io.files import must_exist, read_text, reading, replacing_folder
from posefuse.io.results.format import ResultFacts, ResultFormat
from posefuse.io.results.names import safe_names
from posefuse.io.results.rows import blocks, rows_of
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.stored_points import StoredPoints

MM_PER_M = 1000.0
HEAD = "posefuse.json"
_EXTRA = "posefuse"
_FOLDER = "output_data"
_OWNED = (f"{_FOLDER}/{HEAD}", f"{_FOLDER}/{_EXTRA}/*.npy", f"{_FOLDER}/raw_data/*_3dData_*.npy", f"{_FOLDER}/*_3d*")
_DATA = "3dData_numFrames_numTrackedPoints"
_BY_CAMERA = "3dData_numCams_numFrames_numTrackedPoints"
_TRACKERS = {"coco_wholebody_133": "rtmpose"}
_BODY, _HAND = 33, 21
_FIELDS = ("covariance_m2", "status", "source", "reprojection_error_px", "view_status", "view_error_px")
_ABSENT = {"status": -1, "source": 0, "view_status": -1}


@dataclass(frozen=True)
class Array:
    """An array that is written block by block.

    Attributes:
        name: path of the file, relative to ``output_data``, without the ending.
        shape: shape of the whole array.
        dtype: type of the elements.
        rows: function that yields consecutive blocks; flattened and concatenated, they are the whole array.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype
    rows: Callable[[], Iterator[np.ndarray]]


def tracker_of(skeleton: str) -> str:
    """Return the name of the tracker in FreeMoCap's file names for a skeleton."""
    if skeleton.startswith("mediapipe"):
        return "mediapipe"
    return _TRACKERS.get(skeleton) or safe_names([skeleton])[0]


def write(result: Reconstruction, person: str, path: Path, layer: LayerName) -> None:
    """Write one person into ``path/output_data``.

    Raises:
        ResultError: if there are no frames, or the result comes from a single camera.
        FileError: if the folder holds something else.
    """
    require(ResultFacts.of(result))
    arrays = arrays_of(result, person, layer)
    row_indices, _ = rows_of(result, "freemocap")
    with replacing_folder(path, f"{_FOLDER}/{HEAD}", _OWNED) as staging:
        for array in arrays:
            _write_array(staging / _FOLDER / f"{array.name}.npy", array)
        points = result.layers[layer].points_m
        for part, titles, columns in parts_of(result.skeleton.keypoints, result.skeleton.name):
            name = f"{tracker_of(result.skeleton.name)}_{part}_3d_xyz.csv"
            selected = _points_mm(points, result.person_ids.index(person), columns)
            tables = (
                {f"{title}_{axis}": block[:, k, i] for k, title in enumerate(titles) for i, axis in enumerate("xyz")}
                for block in blocks(selected, row_indices)
            )
            write_csv(tables, staging / _FOLDER / name, quoted_header=False)
        (staging / _FOLDER / HEAD).write_text(description_of(result, person, layer), "utf-8")


def _write_array(path: Path, array: Array) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        write_npy(file, array)


def write_npy(file: object, array: Array) -> None:
    """Write an array to a binary file in .npy format, block by block."""
    header = {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape}
    np.lib.format.write_array_header_1_0(file, header)  # type: ignore[arg-type]
    for block in array.rows():
        file.write(np.ascontiguousarray(block).tobytes())  # type: ignore[attr-defined]


def description_of(result: Reconstruction, person: str, layer: LayerName) -> str:
    """Return the JSON text that describes the arrays."""
    description = {
        "version": 1,
        "person": person,
        "layer": layer,
        "raw_layer": _raw_layer(result, layer),
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
    return json.dumps(description, indent=1)


def _raw_layer(result: Reconstruction, layer: LayerName) -> LayerName:
    return "measured" if "measured" in result.layers else layer


def parts_of(keypoints: tuple[str, ...], skeleton: str) -> list[tuple[str, list[str], list[int]]]:
    """Return the parts into which FreeMoCap splits a skeleton: part, column titles in CSV, and keypoint indices."""
    all_indices = list(range(len(keypoints)))
    if not skeleton.startswith("mediapipe") or len(keypoints) < _BODY:
        return [("body", [f"body_{name}" for name in keypoints], all_indices)]
    body, rest = all_indices[:_BODY], all_indices[_BODY:]
    parts = [("body", [f"body_{keypoints[i]}" for i in body], body)]
    for side in ("right", "left"):
        start = keypoints.index(f"{side}_hand_root") if f"{side}_hand_root" in keypoints else None
        if start is not None:
            hand = all_indices[start : start + _HAND]
            rest = [i for i in rest if i not in hand]
            parts.append((f"{side}_hand", [f"{side}_hand_{i:04d}" for i in range(len(hand))], hand))
    if rest:
        parts.append(("face", [f"face_{i:04d}" for i in range(len(rest))], rest))
    return parts


class _Selection:
    """The values of one person and of selected keypoints, scaled; read by ranges of frames."""

    def __init__(self, source: ArraySource, person: int, columns: list[int] | None, scale: float) -> None:
        self._source, self._person, self._columns, self._scale = source, person, columns, scale
        keypoints = source.shape[2] if columns is None else len(columns)
        self.shape = (source.shape[0], keypoints, *source.shape[3:])
        self.dtype = np.dtype(source.dtype)

    def __getitem__(self, key: slice) -> np.ndarray:
        values = np.asarray(self._source[key])[:, self._person]
        values = values if self._columns is None else values[:, self._columns]
        return values if self._scale == 1.0 else values * self._scale


def _points_mm(source: ArraySource, person: int, columns: list[int] | None = None) -> ArraySource:
    return _Selection(source, person, columns, MM_PER_M)


def require(facts: ResultFacts) -> None:
    """Refuse results that the arrays cannot hold.

    Raises:
        ResultError: if the points are not in meters, there are no frames, or nearly all rows would be empty.
    """
    facts.require_meters("freemocap")
    rows_of(facts, "freemocap")


def arrays_of(result: Reconstruction, person: str, layer: LayerName) -> list[Array]:
    """Return all arrays of one person.

    Raises:
        ResultError: if there are no frames, or nearly all rows would be empty.
    """
    row_indices, n_rows = rows_of(result, "freemocap")
    index, tracker = result.person_ids.index(person), tracker_of(result.skeleton.name)
    raw, requested = result.layers[_raw_layer(result, layer)], result.layers[layer]

    def rows(name: str, source: ArraySource, missing: float = np.nan) -> Array:
        shape = (n_rows, *source.shape[1:])
        return Array(name, shape, np.dtype(source.dtype), lambda: blocks(source, row_indices, missing))

    def of_person(source: ArraySource) -> ArraySource:
        return _Selection(source, index, None, 1.0)

    arrays = [
        rows(f"raw_data/{tracker}_{_DATA}_spatialXYZ", _points_mm(raw.points_m, index)),
        rows(f"raw_data/{tracker}_{_DATA}_reprojectionError", of_person(raw.reprojection_error_px)),
        _by_camera(
            f"raw_data/{tracker}_{_BY_CAMERA}_reprojectionError", of_person(raw.view_error_px), row_indices, n_rows
        ),
        rows(f"{tracker}_skeleton_3d", _points_mm(requested.points_m, index)),
    ]
    for part, _, columns in parts_of(result.skeleton.keypoints, result.skeleton.name):
        arrays.append(rows(f"{tracker}_{part}_3d_xyz", _points_mm(requested.points_m, index, columns)))
    for name in _FIELDS:
        arrays.append(rows(f"{_EXTRA}/{name}", of_person(getattr(requested, name)), _ABSENT.get(name, np.nan)))
    for name, values in (("frame_number", result.frame_numbers), ("time_s", result.time_s)):
        arrays.append(Array(f"{_EXTRA}/{name}", values.shape, values.dtype, lambda values=values: iter([values])))
    return arrays


def _by_camera(name: str, source: ArraySource, row_indices: np.ndarray, n_rows: int) -> Array:
    """Return an array with FreeMoCap's order of axes, camera first; the frames are read once per camera."""
    keypoints, views = source.shape[1:]

    def rows() -> Iterator[np.ndarray]:
        for view in range(views):
            yield from (block[..., view].astype(np.float64) for block in blocks(source, row_indices))

    return Array(name, (views, n_rows, keypoints), np.dtype(np.float64), rows)


def matches(path: Path) -> bool:
    """Return whether a folder was written by posefuse."""
    return (path / _FOLDER / HEAD).is_file()


def read(path: Path) -> StoredPoints:
    """Read a folder that posefuse wrote.

    Raises:
        FileError: if it is not such a folder, or an array is corrupt.
    """
    head_file = must_exist(path / _FOLDER / HEAD, "FreeMoCap arrays written by posefuse")

    def array(name: str) -> np.ndarray:
        file = must_exist(path / _FOLDER / f"{name}.npy", "array")
        with reading(file, ".npy file"):
            return np.load(file, allow_pickle=False)

    return points_of(head_file, read_text(head_file), array)


def points_of(path: Path, head: str, array: Callable[[str], np.ndarray]) -> StoredPoints:
    """Return the requested layer from its description and arrays.

    Args:
        path: path of the description, for error messages.
        head: JSON text that describes the arrays.
        array: function that returns an array by name.

    Raises:
        FileError: if an array is missing, or the arrays are inconsistent.
    """
    with reading(path, "description of FreeMoCap arrays"):
        description = json.loads(head)
        frame_numbers = array(f"{_EXTRA}/frame_number")
        row_indices = frame_numbers - frame_numbers[:1]
        values = {name: array(f"{_EXTRA}/{name}")[row_indices][:, None] for name in _FIELDS}
        points = array(f"{description['tracker']}_skeleton_3d")
        if len(row_indices) == 0 or row_indices[-1] + 1 != len(points):
            raise FileError(
                f"{path}: {len(points)} rows of points are inconsistent with {len(frame_numbers)} frame numbers."
            )
        return StoredPoints(
            keypoints=tuple(description["keypoints"]),
            person_ids=(description["person"],),
            frame_numbers=frame_numbers,
            time_s=array(f"{_EXTRA}/time_s"),
            points_m=points[row_indices][:, None] / MM_PER_M,
            unit="m",
            layer=description["layer"],
            rate_hz=description["rate_hz"],
            view_names=tuple(description["cameras"]),
            **values,
        )


FORMAT = ResultFormat(
    name="freemocap",
    files="one folder per person with output_data/*.npy, *.csv",
    conventions=(
        "FreeMoCap's names and shapes; mm, world axes; one row per frame; all other fields in output_data/posefuse"
    ),
    require=require,
    additional_name="freemocap",
    is_folder=True,
    holds_measured_layer=True,
    matches=matches,
    read=read,
    write_person=write,
)
