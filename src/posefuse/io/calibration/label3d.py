"""DANNCE's and Label3D's ``.mat``: mm; K and R are transposed because MATLAB uses row vectors.

``params`` has ``K``, ``RDistort`` (k1 k2 k3), ``TDistort`` (p1 p2), ``r`` and ``t`` of each camera; ``camnames``, as
in ``*_dannce.mat`` and ``label3d_demo.mat``, has their names. MATLAB counts pixels from 1, so principal points exceed
OpenCV's by one, and so do labeled points. Neither is corrected.
"""

from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.calibration.camera_records import CameraRecord, as_numbers, build_rig
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.matlab import read_mat, variable_names
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_FIELDS = ("K", "RDistort", "TDistort", "r", "t")


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    return path.suffix == ".mat" and path.is_file() and "params" in variable_names(path)


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of the file.

    Raises:
        FileError: if the file does not conform to its format.
        CameraError: if a camera's parameters are invalid.
    """
    data = read_mat(path, ("params", "camnames"))
    params = np.asarray(data["params"], dtype=object).ravel()
    names = [name for name in np.asarray(data.get("camnames", ()), dtype=object).ravel() if isinstance(name, str)]
    if len(names) != len(params):
        names = [f"Camera{i}" for i in range(1, len(params) + 1)]
    records = [_camera(path, name, entry) for name, entry in zip(names, params, strict=True)]
    return build_rig(path, records, unit, "mm")


def _camera(path: Path, name: str, entry: Any) -> CameraRecord:
    where = f"{path}, camera {name!r}"
    inside = entry.ravel()[0] if isinstance(entry, np.ndarray) and entry.size else entry
    missing = [field for field in _FIELDS if not isinstance(inside, dict) or field not in inside]
    if missing:
        raise FileError(f"{where}: params has no {missing[0]}; it must have {', '.join(_FIELDS)}.")
    matrix, radial, tangential, rotation, translation = (
        as_numbers(inside[f].T if isinstance(inside[f], np.ndarray) else inside[f], f"{where}: {f}") for f in _FIELDS
    )
    k1, k2, k3 = np.concatenate([radial, np.zeros(3)])[:3]
    p1, p2 = np.concatenate([tangential, np.zeros(2)])[:2]
    return CameraRecord(name, matrix, rotation, translation, (k1, k2, p1, p2, k3))


FORMAT = CalibrationFormat(
    name="label3d",
    files="*.mat with params (also DANNCE)",
    conventions="mm; K and R transposed; up axis unknown: `up`",
    recognized_by="MATLAB variable params",
    matches=matches,
    read=read,
)
