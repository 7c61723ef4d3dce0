"""DeepFly3D points of a tethered fly, in an ``.npz`` with ``points2d_px`` or ``points2d`` (camera, frame, 38, 2).

Pixels; (0, 0) is missing, because each camera sees one side. Cameras are named by their index (0, 1, ...), like those
of the calibration in the same file. There is no frame rate.
"""

from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import read_npz
from posefuse.io.keypoints.arrays import from_array
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.request import Request
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import shipped_skeleton

_NAMES = ("points2d_px", "points2d")
_POINTS = 38


def matches(path: Path) -> bool:
    """Return whether a file is in this format."""
    return path.suffix == ".npz" and path.is_file() and _points(path) is not None


def _points(path: Path) -> np.ndarray | None:
    try:
        arrays = read_npz(path, _NAMES)
    except FileError:
        return None
    return next((array for array in arrays.values() if array.ndim == 4 and array.shape[2:] == (_POINTS, 2)), None)


def read(path: Path, request: Request) -> Detections:
    """Read all cameras.

    Raises:
        FileError: If the file is truncated or in another format.
    """
    points = _points(path)
    if points is None:
        raise FileError(f"{path} contains no points2d_px (camera, frame, {_POINTS}, 2).")
    skeleton = request.skeleton or shipped_skeleton("fly_38")
    array_request = Request(skeleton, request.rate_hz, request.third_channel, request.progress)
    return from_array(path, points, [str(v) for v in range(len(points))], request.rate_hz, array_request)


FORMAT = KeypointFormat(
    name="deepfly",
    files="*.npz with points2d_px (camera, frame, 38, 2)",
    conventions="px; 0 0 is missing; skeleton fly_38; cameras by position; no frame rate: `rate_hz`",
    recognized_by="array points2d of (camera, frame, 38, 2) in an .npz",
    matches=matches,
    read=read,
)
