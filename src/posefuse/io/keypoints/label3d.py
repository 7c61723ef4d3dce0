"""Labels of Label3D and DANNCE (``.mat`` with ``labelData``): manual x and y of every keypoint of one animal.

Each camera has ``data_2d`` (frame, 2 x keypoint), with frame numbers in ``data_frame`` if it exists; NaN and (0, 0) are
missing. The pixel convention is that of the calibration in the same file. The file has no keypoint names: the skeleton
is given by ``--skeleton`` or inferred from the number of keypoints.
"""

from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.keypoints.columns import ViewColumns
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.people import Person, detections_of, view_columns
from posefuse.io.keypoints.request import Request
from posefuse.io.matlab import read_mat, variable_names
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import shipped_skeleton, shipped_skeletons


def matches(path: Path) -> bool:
    """Return whether a file is in this format."""
    return path.suffix == ".mat" and path.is_file() and "labelData" in variable_names(path)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: If the file is truncated or in another format.
        SkeletonError: If the number of keypoints does not identify a skeleton.
    """
    data = read_mat(path, ("labelData", "camnames"))
    cells = np.asarray(data.get("labelData"), dtype=object).ravel()
    names = [name for name in np.asarray(data.get("camnames", ()), dtype=object).ravel() if isinstance(name, str)]
    if len(names) != len(cells):
        names = [f"Camera{i}" for i in range(1, len(cells) + 1)]
    views = [_view(path, name, cell) for name, cell in zip(names, cells, strict=True)]
    return detections_of(path, views, _with_skeleton(request, views), sparse=True)


def _view(path: Path, name: str, cell: Any) -> ViewColumns:
    where = f"{path}, camera {name!r}"
    inside = cell.ravel()[0] if isinstance(cell, np.ndarray) and cell.size else cell
    labels: dict[str, Any] = inside if isinstance(inside, dict) else {}
    pixels, stored_frames = labels.get("data_2d"), labels.get("data_frame")
    if not isinstance(pixels, np.ndarray) or pixels.ndim != 2 or pixels.shape[1] % 2 or pixels.dtype.kind not in "fiu":
        raise FileError(f"{where}: expected data_2d (frame, 2 x keypoint) in labelData.")
    positions = pixels.astype(np.float64).reshape(len(pixels), -1, 2)
    numbers = np.arange(len(positions))
    if (
        isinstance(stored_frames, np.ndarray) and stored_frames.dtype.kind in "fiu"
        and stored_frames.size == len(positions) and np.all(np.abs(stored_frames) < 2**40)
        and len(np.unique(stored_frames)) == len(positions)
    ):  # fmt: skip
        numbers = stored_frames.ravel().astype(np.int64)
    values = np.concatenate([positions, np.ones((*positions.shape[:2], 1))], axis=-1)
    people = [Person(int(number), rows, 0) for number, rows in zip(numbers, values, strict=True)]
    return view_columns(name, numbers.tolist(), people, where)


def _with_skeleton(request: Request, views: list[ViewColumns]) -> Request:
    """Return the request with the only shipped skeleton of this number of keypoints, if it names none."""
    count = next((view.keypoints.shape[1] for view in views if len(view.keypoints)), 0)
    fitting = [skeleton for name in shipped_skeletons() if len(skeleton := shipped_skeleton(name)) == count]
    if request.skeleton is not None or len(fitting) != 1:
        return request
    return Request(fitting[0], request.rate_hz, request.third_channel, request.progress)


FORMAT = KeypointFormat(
    name="label3d",
    files="*.mat with labelData (also DANNCE)",
    conventions="px, as in the calibration of the file; manual labels of one animal; no frame rate: `rate_hz`",
    recognized_by="MATLAB variable labelData",
    matches=matches,
    read=read,
)
