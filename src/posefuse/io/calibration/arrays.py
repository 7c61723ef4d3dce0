"""Cameras as arrays of an ``.npz``: ``K`` (camera, 3, 3), ``R`` (camera, 3, 3) or Rodrigues, ``t`` or ``tvec``.

As DeepFly3D's numbers and many scripts of laboratories have them: world to camera, OpenCV's distortion under ``dist``
(camera, 4 to 14) where there is any, names of the cameras under ``names``, else their places (0, 1, ...). The unit is
guessed as it is of other files that do not say, and so is the size of the images, unless ``size`` (camera, 2) holds it.
"""

from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.io.calibration.building import Found, build_rig
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import read_npz
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_PLACES = ("t", "tvec", "T")


def matches(path: Path) -> bool:
    """Whether the file is one."""
    if path.suffix != ".npz" or not path.is_file():
        return False
    try:
        names = set(read_npz(path, ()))
    except FileError:
        return False
    return {"K", "R"} <= names and bool(names & set(_PLACES))


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras, in the file's order.

    Raises:
        FileError: if the arrays are not of as many cameras each.
        CameraError: if a camera's numbers cannot be.
    """
    held = read_npz(path, ("K", "R", *_PLACES, "dist", "names", "size"))
    place = next((held[name] for name in _PLACES if name in held), None)
    if place is None or "K" not in held or "R" not in held:
        raise FileError(f"{path} should hold K, R and t of the cameras; it holds {', '.join(held)}.")
    n = len(np.atleast_1d(held["K"]))
    arrays = {"K": held["K"], "R": held["R"], "t": place}
    arrays |= {name: held[name] for name in ("dist", "names", "size") if name in held}
    for name, array in arrays.items():
        if array.ndim == 0 or len(array) != n:
            raise FileError(f"{path}: {name} should be of {n} cameras, as K is; got shape {array.shape}.")
    names = [str(name) for name in arrays.get("names", range(n))]
    found = []
    for v in range(n):
        lens = arrays["dist"][v] if "dist" in arrays else ()
        size = arrays["size"][v].tolist() if "size" in arrays else None
        found.append(Found(names[v], arrays["K"][v], arrays["R"][v], place[v], lens, size))
    return build_rig(path, found, unit, None)


FORMAT = CalibrationFormat(
    name="arrays",
    files="*.npz with K, R, t (or tvec), dist (also DeepFly3D)",
    conventions="world to camera; --length-unit; up axis unknown: --up",
    recognized_by="arrays K, R, t in an .npz",
    matches=matches,
    read=read,
)
