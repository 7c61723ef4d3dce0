"""Projection matrices P = K [R | t]: ``.npy`` of shape (camera, 3, 4), or ``P_<name>.txt``, one per camera.

RQ decomposition of P gives K with positive focal lengths and a rotation with determinant 1; the scale and sign of P do
not matter. Lenses are assumed to have no distortion, and the unit is guessed as for other files that do not state it.
"""

from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.io.calibration.camera_records import LARGEST_BYTES, CameraRecord, as_numbers, build_rig, small_text
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import natural_key
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_MAX_CONDITION = 1e12


def matches(path: Path) -> bool:
    """Return whether the file is in this format, or the folder contains such files."""
    if path.suffix == ".npy" and path.is_file():
        return _array(path) is not None
    return bool(_texts(path))


def _texts(path: Path) -> list[Path]:
    folder = path if path.is_dir() else path.parent
    if not path.is_dir() and not _named(path):
        return []
    return sorted((entry for entry in folder.iterdir() if _named(entry)), key=lambda entry: natural_key(entry.name))


def _named(path: Path) -> bool:
    return path.suffix == ".txt" and path.name.startswith("P_") and path.is_file()


def _array(path: Path) -> np.ndarray | None:
    try:
        if path.stat().st_size > LARGEST_BYTES:
            return None
        array = np.load(path, allow_pickle=False)
    except Exception:  # a corrupt header can raise any exception
        return None
    return array if array.ndim == 3 and array.shape[1:] == (3, 4) and array.dtype.kind in "fi" else None


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras: numbered 0, 1, ... in an array, named by the part after ``P_`` in text files.

    Raises:
        FileError: if a matrix is not 3 x 4, or not a valid projection matrix.
        CameraError: if a camera's parameters are invalid.
    """
    array = _array(path) if path.suffix == ".npy" else None
    if array is not None:
        named = [
            (str(i), as_numbers(matrix, f"{path}, camera '{i}': P").reshape(3, 4)) for i, matrix in enumerate(array)
        ]
    else:
        named = [(file.stem.removeprefix("P_"), _read_text(file)) for file in _texts(path)]
    records = [CameraRecord(name, *decompose_projection(matrix, f"{path}, camera {name!r}")) for name, matrix in named]
    return build_rig(path, records, unit, None)


def _read_text(file: Path) -> np.ndarray:
    values = as_numbers(small_text(file).replace(",", " ").split(), f"{file}: the text")
    if values.size != 12:
        raise FileError(f"{file} must contain the 12 numbers of P in 3 rows, got {values.size}.")
    return values.reshape(3, 4)


def decompose_projection(projection: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return K, R and t of P = K [R | t].

    Source: Hartley & Zisserman, Multiple View Geometry, section 6.2.4.

    Raises:
        FileError: if P is not the projection matrix of a finite camera.
    """
    from scipy.linalg import rq

    left = projection[:, :3]
    if not np.linalg.cond(left) < _MAX_CONDITION:
        raise FileError(f"{where}: P is not a projection matrix; its left 3 x 3 part is singular or not finite.")
    # If the determinant is negative, -P is the same camera.
    projection = projection * np.sign(np.linalg.det(left))
    upper, rotation = rq(projection[:, :3])
    signs = np.where(np.diag(upper) < 0, -1.0, 1.0)
    upper, rotation = upper * signs, signs[:, None] * rotation
    translation = np.linalg.solve(upper, projection[:, 3])
    matrix = upper / upper[2, 2]
    matrix[np.tril_indices(3, -1)] = 0.0
    return matrix, rotation, translation


FORMAT = CalibrationFormat(
    name="projections",
    files="*.npy (camera, 3, 4), or P_*.txt",
    conventions="P = K [R | t]; no lens distortion; `length_unit`; up axis unknown: `up`",
    recognized_by="matrices of 3 x 4 numbers",
    matches=matches,
    read=read,
)
