"""Cameras as arrays of an ``.npz``: ``K`` (camera, 3, 3), ``R`` (camera, 3, 3) or Rodrigues, ``t`` or ``tvec``.

This layout is used by DeepFly3D and by many laboratory scripts: world to camera, OpenCV's distortion coefficients in
``dist`` (camera, 4 to 14) if there are any, and names of the cameras in ``names``, by default 0, 1, ... The unit is
guessed as for other files that do not state it, and so is the image size unless there is ``size`` (camera, 2).
"""

from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.io.calibration.camera_records import CameraRecord, build_rig
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import read_npz
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_TRANSLATION_NAMES = ("t", "tvec", "T")


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    if path.suffix != ".npz" or not path.is_file():
        return False
    try:
        names = set(read_npz(path, ()))
    except FileError:
        return False
    return {"K", "R"} <= names and bool(names & set(_TRANSLATION_NAMES))


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of the file.

    Raises:
        FileError: if the arrays differ in the number of cameras.
        CameraError: if a camera's parameters are invalid.
    """
    held = read_npz(path, ("K", "R", *_TRANSLATION_NAMES, "dist", "names", "size"))
    translations = next((held[name] for name in _TRANSLATION_NAMES if name in held), None)
    if translations is None or "K" not in held or "R" not in held:
        raise FileError(f"{path}: expected the arrays K, R and t of the cameras, got {', '.join(held)}.")
    n = len(np.atleast_1d(held["K"]))
    arrays = {"K": held["K"], "R": held["R"], "t": translations}
    arrays |= {name: held[name] for name in ("dist", "names", "size") if name in held}
    for name, array in arrays.items():
        if array.ndim == 0 or len(array) != n:
            raise FileError(f"{path}: {name} must have {n} cameras, as K does; got shape {array.shape}.")
    names = [str(name) for name in arrays.get("names", range(n))]
    records = []
    for v in range(n):
        lens = arrays["dist"][v] if "dist" in arrays else ()
        size = arrays["size"][v].tolist() if "size" in arrays else None
        records.append(CameraRecord(names[v], arrays["K"][v], arrays["R"][v], translations[v], lens, size))
    return build_rig(path, records, unit, None)


FORMAT = CalibrationFormat(
    name="arrays",
    files="*.npz with K, R, t (or tvec), dist (also DeepFly3D)",
    conventions="world to camera; `length_unit`; up axis unknown: `up`",
    recognized_by="arrays K, R, t in an .npz",
    matches=matches,
    read=read,
)
