"""Foot contact in ``reconstruction.nc``.

``foot_contact`` (time, individual, foot, foot_part) is the probability that the heel or the toes of the left and of the
right foot touch a level, and ``foot_sliding`` (time, individual, foot) the probability that a touching foot slides; NaN
where a foot has no points. The attribute ``layer`` names the layer of the points.
"""

from pathlib import Path

import h5netcdf
import numpy as np

from posefuse.io.files import reading
from posefuse.io.netcdf import OutputFile, add_variable, write_rows


def add_contact(path: Path, contact: np.ndarray, sliding: np.ndarray, layer: str) -> None:
    """Add contact to a ``reconstruction.nc`` that has none.

    Args:
        path: the file, with as many frames and people as the arrays.
        contact: shape (frame, person, 2, 2): feet left and right, parts heel and toes.
        sliding: shape (frame, person, 2).
        layer: name of the layer.
    """
    with OutputFile(path, "r+") as file:
        file.add_dimensions({"foot": 2, "foot_part": 2})
        add_variable(file, "foot", ("foot",), np.array(["left", "right"], dtype=object))
        add_variable(file, "foot_part", ("foot_part",), np.array(["heel", "toes"], dtype=object))
        axes = ("time", "individual", "foot")
        add_variable(file, "foot_contact", (*axes, "foot_part"), dtype="f4", units="1", layer=layer)
        add_variable(file, "foot_sliding", axes, dtype="f4", units="1", layer=layer)
        write_rows(file, "foot_contact", 0, contact.astype(np.float32))
        write_rows(file, "foot_sliding", 0, sliding.astype(np.float32))


def read_contact(path: Path) -> np.ndarray | None:
    """Return the probability of contact, shape (frame, person, foot, part), or None without any.

    Raises:
        FileError: if the file is damaged.
    """
    with reading(path, "netCDF-4 file"), h5netcdf.File(path, "r") as file:
        if "foot_contact" not in file.variables:
            return None
        return np.asarray(file.variables["foot_contact"][...])
