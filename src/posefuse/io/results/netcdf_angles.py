"""Joint angles in ``reconstruction.nc``."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np

from posefuse.io.netcdf import OutputFile, add_variable, stored_array, strings, text_of, write_rows
from posefuse.io.results.rounding import rounded_angles
from posefuse.model.joint_angles import AngleStatus, JointAngles

_AXES = ("time", "individual", "joint_angle_name")
_VARIABLES: dict[str, tuple[str, tuple[str, ...], str, str]] = {
    "degrees": ("joint_angle", _AXES, "f4", "degree"),
    "sd_deg": ("joint_angle_sd", _AXES, "f4", "degree"),
    "status": ("joint_angle_status", _AXES, "i1", ""),
    "pelvis_m": ("joint_angle_pelvis", ("time", "individual", "space"), "f8", "m"),
}


def create(file: OutputFile, angles: JointAngles) -> None:
    """Create the variables."""
    file.add_dimensions({"joint_angle_name": len(angles.names)})
    for name, values in (("joint_angle_name", angles.names), ("joint_angle_convention", angles.conventions)):
        add_variable(file, name, ("joint_angle_name",), np.array(values, dtype=object))
    for name, axes, kind, unit in _VARIABLES.values():
        attributes: dict[str, Any] = {"units": unit} if unit else _flags()
        add_variable(file, name, axes, dtype=kind, **attributes)
    file.attrs["joint_angle_layer"] = angles.layer


def append(file: OutputFile, angles: JointAngles, start: int) -> None:
    """Write a range of frames from index ``start`` on."""
    for attribute, (name, *_) in _VARIABLES.items():
        write_rows(file, name, start, getattr(angles, attribute)[:])


def add(parts: Iterable[JointAngles], path: Path) -> None:
    """Add joint angles of all frames to a file without them.

    Args:
        parts: consecutive ranges of frames; without any, the file stays as it is.
        path: a ``reconstruction.nc``.
    """
    file, start = None, 0
    try:
        for part in parts:
            if file is None:
                file = OutputFile(path, "r+")
                create(file, part)
            append(file, rounded_angles(part), start)
            start += len(part.status)
    finally:
        if file is not None:
            file.close()


def read(file: h5netcdf.File, path: Path) -> JointAngles | None:
    """Return the joint angles, read when they are used, or None if there are none."""
    if "joint_angle" not in file.variables:
        return None
    names, conventions = (strings(file.variables[f"joint_angle_{name}"]) for name in ("name", "convention"))
    arrays = {attribute: stored_array(path, name) for attribute, (name, *_) in _VARIABLES.items()}
    return JointAngles(names, conventions, text_of(file, "joint_angle_layer"), **arrays)


def _flags() -> dict[str, Any]:
    return {
        "flag_values": np.array([status.value for status in AngleStatus], dtype=np.int8),
        "flag_meanings": " ".join(status.label for status in AngleStatus),
    }
