"""YAML and XML files of OpenCV's FileStorage: one or two files per camera with intrinsic and extrinsic parameters.

Common key names are recognized (``camera_matrix``, ``cameraMatrix``, ``K``; ``distortion_coefficients``, ``D``; ``R``,
``rvec``; ``T``, ``tvec``; ``image_width``, ``image_height``). Specify the folder or one file; the files beside it are
read, too. Cameras are named after their files, without ``intr_``, ``extr_`` and the like, so that ``intr_left.xml`` and
``extr_left.xml`` belong to one camera. OpenCV's stereo sample (``M1 D1 M2 D2 R T``) gives two cameras, the first at
the origin.

JARVIS' files (``intrinsicMatrix``) store K and R transposed.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError, PosefuseError, choices
from posefuse.io.calibration.camera_records import CameraRecord, build_rig
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.opencv_storage import YAML_SUFFIXES, read_storage
from posefuse.io.files import natural_key
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_SUFFIXES = (*YAML_SUFFIXES, ".xml")
_MAX_FILES = 500
_MATRIX = ("camera_matrix", "cameramatrix", "intrinsicmatrix", "intrinsic_matrix", "mtx", "k")
_DISTORTION = (
    "distortion_coefficients", "distortioncoefficients", "dist_coeffs", "distcoeffs", "dist_coeff", "dist", "d",
)  # fmt: skip
_ROTATION = ("rotation_matrix", "rotation", "rvec", "r")
_TRANSLATION = ("translation_vector", "translation", "tvec", "t")
_PREFIX = re.compile(r"^(intr|intrinsics?|extr|extrinsics?|calib|calibration)[_-]", re.IGNORECASE)
_ENDING = re.compile(r"[_-](intr|intrinsics?|extr|extrinsics?|calib|calibration|params)$", re.IGNORECASE)


@dataclass(frozen=True)
class _Part:
    """Parameters of one camera in one file."""

    file: Path
    name: str
    matrix: Any = None
    distortion: Any = ()
    rotation: Any = None
    translation: Any = None
    size_px: tuple[float, float] | None = None
    fisheye: bool = False


def matches(path: Path) -> bool:
    """Return whether the file has parameters of a camera, or the folder and its neighbors have all of them."""
    if path.is_file():
        return path.suffix in _SUFFIXES and bool(_parts(path))
    parts = _try_parts(_files(path))
    if parts and len({(part.matrix is None, part.rotation is None) for part in parts}) == 1:
        parts = _gather(path)
    return any(part.matrix is not None for part in parts) and any(part.rotation is not None for part in parts)


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of their names.

    Raises:
        FileError: if a file does not conform to its format, or two files have the same parameters of a camera.
        CameraError: if a camera's parameters are invalid.
    """
    parts = _gather(path)
    lenses = _by_name(path, [part for part in parts if part.matrix is not None], "intrinsics")
    places = _by_name(path, [part for part in parts if part.rotation is not None], "extrinsics")
    both = sorted(set(lenses) & set(places), key=natural_key)
    if not both:
        raise FileError(
            f"{path}: no camera has both intrinsics and extrinsics. Intrinsics: {choices(sorted(lenses))}. Extrinsics: "
            f"{choices(sorted(places))}."
        )
    left = sorted(set(lenses) ^ set(places), key=natural_key)
    notes = (f"{path.name}: left out (no intrinsics or no extrinsics): {choices(left)}.",) if left else ()
    records = [
        CameraRecord(
            name, lenses[name].matrix, places[name].rotation, places[name].translation, lenses[name].distortion,
            lenses[name].size_px, fisheye=lenses[name].fisheye,
        )
        for name in both
    ]  # fmt: skip
    return build_rig(path, records, unit, None, notes=notes)


def _gather(path: Path) -> list[_Part]:
    """Return the parts in a folder; if these are only intrinsics or only extrinsics, include neighboring folders."""
    path = path.parent if path.is_file() else path
    parts = _try_parts(_files(path))
    for kind, other in (("matrix", "rotation"), ("rotation", "matrix")):
        if all(getattr(part, kind) is None for part in parts):
            beside = _try_parts(_files(path.parent))
            parts += [part for part in beside if getattr(part, kind) is not None and getattr(part, other) is None]
    return parts


def _files(folder: Path) -> list[Path]:
    def inside(where: Path) -> list[Path]:
        try:
            entries = list(where.iterdir())
        except OSError:
            return []
        return sorted(entries, key=lambda entry: natural_key(entry.name))

    entries = inside(folder)
    deeper = [entry for sub in entries if sub.is_dir() for entry in inside(sub)]
    return [entry for entry in [*entries, *deeper] if entry.suffix in _SUFFIXES and entry.is_file()][:_MAX_FILES]


def _try_parts(files: Iterable[Path]) -> list[_Part]:
    parts = []
    for file in files:
        try:
            parts += _parts(file)
        except PosefuseError:
            continue
    return parts


def _by_name(path: Path, parts: list[_Part], what: str) -> dict[str, _Part]:
    found: dict[str, _Part] = {}
    for part in parts:
        if part.name in found:
            raise FileError(
                f"{path}: two files have the {what} of camera {part.name!r}: {found[part.name].file.parent.name}/"
                f"{found[part.name].file.name} and {part.file.parent.name}/{part.file.name}. Specify the folder of "
                "one of them."
            )
        found[part.name] = part
    return found


def _parts(file: Path) -> list[_Part]:
    """Return the parameters in a file: of one camera, of a stereo pair, or none."""
    entries = read_storage(file)
    lower = {key.lower(): value for key, value in entries.items()}
    if {"m1", "m2"} <= set(lower) or ({"r", "t"} <= set(lower) and {"r1", "p1"} <= set(lower)):
        return _stereo(file, lower)
    matrix, rotation = _first(lower, _MATRIX), _first(lower, _ROTATION)
    if matrix is None and rotation is None:
        return []
    if "intrinsicmatrix" in lower:
        matrix = _transposed(matrix)
        rotation = None if rotation is None else _transposed(rotation)
    size = _size(lower)
    fisheye = bool(lower.get("fisheye_model", 0)) or lower.get("model") == "fisheye"
    return [
        _Part(
            file, _name(file), matrix, _first(lower, _DISTORTION, ()), rotation, _first(lower, _TRANSLATION), size,
            fisheye,
        )
    ]  # fmt: skip


def _stereo(file: Path, lower: dict[str, Any]) -> list[_Part]:
    parts = []
    for number, pose in (("1", (np.eye(3), np.zeros(3))), ("2", (lower.get("r"), lower.get("t")))):
        lens = lower.get(f"m{number}")
        placed = pose if "r" in lower and "t" in lower else (None, None)
        parts.append(_Part(file, number, lens, lower.get(f"d{number}", ()), *placed, _size(lower)))
    return parts


def _first(entries: dict[str, Any], names: Iterable[str], default: Any = None) -> Any:
    return next((entries[name] for name in names if name in entries), default)


def _transposed(values: Any) -> Any:
    array = np.asarray(values)
    return array.T if array.shape == (3, 3) else values


def _size(lower: dict[str, Any]) -> tuple[float, float] | None:
    pairs = (("image_width", "image_height"), ("width", "height"), ("image_w", "image_h"))
    for width, height in pairs:
        if width in lower and height in lower:
            return lower[width], lower[height]
    size = _first(lower, ("image_size", "imagesize", "size", "resolution"))
    values = [] if size is None or isinstance(size, (str, float, int)) else np.asarray(size).ravel().tolist()
    return (values[0], values[1]) if len(values) == 2 else None


def _name(file: Path) -> str:
    stem = _ENDING.sub("", _PREFIX.sub("", file.stem))
    return stem or file.stem


FORMAT = CalibrationFormat(
    name="opencv",
    files="*.yml, *.yaml, *.xml, one or two per camera, or their folder (also JARVIS)",
    conventions="the board's unit: `length_unit`; world to camera; up axis unknown: `up`",
    recognized_by="OpenCV FileStorage matrices, one or two files per camera",
    matches=matches,
    read=read,
)
