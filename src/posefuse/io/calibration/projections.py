"""Plain projection matrices P = K [R | t]: ``.npy`` of shape (camera, 3, 4), or ``P_<name>.txt``, one a camera.

P is taken apart by RQ decomposition into K with positive focal lengths and a rotation of determinant 1; its overall
factor and sign do not matter. Lenses are taken as without distortion, and the unit is guessed as it is of other
files that do not say.
"""

from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.io.calibration.building import LARGEST_BYTES, Found, as_numbers, build_rig, small_text
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import natural_key
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_LARGEST_CONDITION = 1e12


def matches(path: Path) -> bool:
    """Whether the file is one, or the folder holds some."""
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
    except Exception:  # a broken header raises whatever its bytes lead to
        return None
    return array if array.ndim == 3 and array.shape[1:] == (3, 4) and array.dtype.kind in "fi" else None


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras: of an array by their place (0, 1, ...), of texts by the name after ``P_``.

    Raises:
        FileError: if a matrix is not 3 x 4, or none of a camera.
        CameraError: if a camera's numbers cannot be.
    """
    array = _array(path) if path.suffix == ".npy" else None
    if array is not None:
        named = [
            (str(i), as_numbers(matrix, f"{path}, camera '{i}': P").reshape(3, 4)) for i, matrix in enumerate(array)
        ]
    else:
        named = [(file.stem.removeprefix("P_"), _read_text(file)) for file in _texts(path)]
    found = [Found(name, *take_apart(matrix, f"{path}, camera {name!r}")) for name, matrix in named]
    return build_rig(path, found, unit, None)


def _read_text(file: Path) -> np.ndarray:
    values = as_numbers(small_text(file).replace(",", " ").split(), f"{file}: the text")
    if values.size != 12:
        raise FileError(f"{file} should hold the 12 numbers of P in 3 rows, got {values.size}.")
    return values.reshape(3, 4)


def take_apart(projection: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K, R and t of P = K [R | t]; Hartley & Zisserman, Multiple View Geometry, section 6.2.4.

    Raises:
        FileError: if P is no finite camera's.
    """
    from scipy.linalg import rq

    left = projection[:, :3]
    if not np.linalg.cond(left) < _LARGEST_CONDITION:
        raise FileError(f"{where}: P is no camera's; its left 3 x 3 part is singular or not finite.")
    # With a determinant that is negative, -P is the same camera.
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
    conventions="P = K [R | t]; no lens distortion; --length-unit; up axis unknown: --up",
    recognized_by="matrices of 3 x 4 numbers",
    matches=matches,
    read=read,
)
