"""OpenCap's ``cameraIntrinsicsExtrinsics.pickle``, one per camera (``Videos/Cam0/...``): mm, world to camera.

The world is the checkerboard, which is mounted vertically, so the up axis is unknown (``--up``). ``imageSize`` is
height, width; ``rotation_EulerAngles`` is a Rodrigues vector. Pickles can execute code: this reader constructs only
numbers and arrays, without NumPy's own constructors, and rejects everything else.
"""

import io
import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.calibration.camera_records import LARGEST_BYTES, CameraRecord, as_numbers, build_rig
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import natural_key
from posefuse.io.pickles import check_memo
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

NAME = "cameraIntrinsicsExtrinsics.pickle"
_NEEDED = ("intrinsicMat", "distortion", "imageSize", "rotation", "translation")
_CORES = ("numpy.core.multiarray", "numpy._core.multiarray")


_KIND = re.compile(r"[fiu][1248]|b1")


class _Kind:
    """Replacement of NumPy's dtype; a corrupt or hostile pickle could construct a dtype that crashes NumPy."""

    def __init__(self, code: Any = "", *_: Any) -> None:
        self._code, self._order = str(code), "="

    def __setstate__(self, state: Any) -> None:
        self._order = str(state[1])

    def values(self, content: Any) -> np.ndarray:
        """Return the numbers encoded in ``content``."""
        if not _KIND.fullmatch(self._code) or self._order not in ("<", ">", "=", "|"):
            raise pickle.UnpicklingError(f"it has the data type {self._code[:20]!r}, which is not allowed")
        return np.frombuffer(content, np.dtype(self._order + self._code)).astype(np.float64)


class _Array:
    """Replacement of NumPy's array."""

    def __init__(self, *_: Any) -> None:
        self.numbers = np.empty(0)

    def __setstate__(self, state: Any) -> None:
        _, shape, kind, fortran, content = state
        self.numbers = kind.values(content).reshape(shape, order="F" if fortran else "C")


def _scalar(kind: _Kind, content: Any) -> float:
    return float(kind.values(content)[0])


class _Numbers(pickle.Unpickler):
    """An unpickler that constructs arrays and numbers only."""

    def find_class(self, module: str, name: str) -> Any:
        if module == "numpy" and name in ("ndarray", "dtype"):
            return _Kind if name == "dtype" else _Array
        if module in _CORES and name in ("_reconstruct", "scalar"):
            return _Array if name == "_reconstruct" else _scalar
        if (module, name) == ("_codecs", "encode"):
            return _latin
        raise pickle.UnpicklingError(f"it contains {module}.{name}, which is not allowed")


def _latin(text: str, encoding: str = "latin1") -> bytes:
    """Decode bytes as pickle protocol 2 stores them, always in latin1."""
    return text.encode("latin1")


def matches(path: Path) -> bool:
    """Return whether the file is in this format, or subfolders contain one such file each."""
    return bool(_files(path))


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.name == NAME else []
    inside = [entry / NAME for entry in path.iterdir() if entry.is_dir()]
    return sorted((file for file in inside if file.is_file()), key=lambda file: natural_key(file.parent.name))


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras, named after their folders, in the order of the names.

    Raises:
        FileError: if a file does not conform to its format, or contains anything but numbers.
        CameraError: if a camera's parameters are invalid.
    """
    files = _files(path)
    if path.is_file():
        # A single camera cannot measure depth; the files of the others are in folders beside it.
        files = _files(path.parent.parent) or files
    return build_rig(path, [_camera(file) for file in files], unit, "mm")


def _camera(file: Path) -> CameraRecord:
    data = _load(file)
    missing = [key for key in _NEEDED if key not in data]
    if missing:
        raise FileError(f"{file} has no {missing[0]}; it must have {', '.join(_NEEDED)}.")
    size = as_numbers(data["imageSize"], f"{file}: imageSize")
    if size.size != 2:
        raise FileError(f"{file}: imageSize must contain height and width, got {size.size} numbers.")
    return CameraRecord(
        file.parent.name, data["intrinsicMat"], data["rotation"], data["translation"], data["distortion"],
        (size[1], size[0]),
    )  # fmt: skip


def _load(file: Path) -> dict[str, Any]:
    try:
        if file.stat().st_size > LARGEST_BYTES:
            raise ValueError("it is too large for a calibration")
        data = _Numbers(io.BytesIO(check_memo(file.read_bytes()))).load()
    except Exception as error:  # a corrupt pickle can raise any exception
        raise FileError(f"{file} cannot be read as a camera's pickle: {str(error)[:120]}.") from None
    if not isinstance(data, dict):
        raise FileError(f"{file}: expected a dict of camera parameters, got {type(data).__name__}.")
    return {key: value.numbers if isinstance(value, _Array) else value for key, value in data.items()}


FORMAT = CalibrationFormat(
    name="opencap",
    files="*/cameraIntrinsicsExtrinsics.pickle, or their folder",
    conventions="mm; world to camera; up axis unknown: `up`; pickled code is never executed",
    recognized_by="cameraIntrinsicsExtrinsics.pickle in one folder per camera",
    matches=matches,
    read=read,
)
