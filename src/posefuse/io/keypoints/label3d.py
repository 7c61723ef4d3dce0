"""Label3D's and DANNCE's labels (``.mat`` with ``labelData``): by hand, x and y of every keypoint, one animal.

``data_2d`` (frame, 2 x keypoint) of each camera, frames by ``data_frame`` where it is there; NaN and 0, 0 are
missing. Pixels count as in the calibration of the same file. The joints' names are not in it: ``--skeleton``, or as
many keypoints as a shipped skeleton has.
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
    """Whether the file is one."""
    return path.suffix == ".mat" and path.is_file() and "labelData" in variable_names(path)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: if the file is cut short or another.
        SkeletonError: if the number of keypoints does not tell the skeleton.
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
    pixels, given = labels.get("data_2d"), labels.get("data_frame")
    if not isinstance(pixels, np.ndarray) or pixels.ndim != 2 or pixels.shape[1] % 2 or pixels.dtype.kind not in "fiu":
        raise FileError(f"{where}: labelData should have data_2d (frame, 2 x keypoint).")
    places = pixels.astype(np.float64).reshape(len(pixels), -1, 2)
    numbers = np.arange(len(places))
    if (
        isinstance(given, np.ndarray) and given.dtype.kind in "fiu" and given.size == len(places)
        and np.all(np.abs(given) < 2**40) and len(np.unique(given)) == len(places)
    ):  # fmt: skip
        numbers = given.ravel().astype(np.int64)
    values = np.concatenate([places, np.ones((*places.shape[:2], 1))], axis=-1)
    people = [Person(int(number), rows, 0) for number, rows in zip(numbers, values, strict=True)]
    return view_columns(name, numbers.tolist(), people, where)


def _with_skeleton(request: Request, views: list[ViewColumns]) -> Request:
    """Label3D is of animals: of the shipped skeletons with so many keypoints the one that is no human's."""
    count = next((view.keypoints.shape[1] for view in views if len(view.keypoints)), 0)
    fitting = [skeleton for name in shipped_skeletons() if len(skeleton := shipped_skeleton(name)) == count]
    if request.skeleton is not None or len(fitting) != 1:
        return request
    return Request(fitting[0], request.rate_hz, request.third_channel, request.progress)


FORMAT = KeypointFormat(
    name="label3d",
    files="*.mat with labelData (also DANNCE)",
    conventions="px, as in the calibration of the file; manual labels of one animal; no frame rate: --rate-hz",
    recognized_by="MATLAB variable labelData",
    matches=matches,
    read=read,
)
