"""netCDF for the package ``movement``: ``position`` (time, space, keypoint, individual) and ``confidence``.

Dimensions are named as in movement since 0.17 (keypoint, individual); earlier versions use plural names, see the docs.
Lengths are in meters, in world axes. ``time`` is in seconds, or in frame numbers if times are unknown. Results have no
confidence; ``confidence`` is NaN, because movement requires the variable. Additional variables: ``status``, ``source``
(their attributes list the codes), ``reprojection_error``, ``n_views``, ``covariance`` (.., covariance_entry),
``view_status``, ``view_error`` (.., view).
"""

from enum import IntEnum
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.files import must_exist, replacing
from posefuse.io.hdf5 import open_hdf5
from posefuse.io.netcdf import OutputFile, add_variable, strings, write_rows
from posefuse.io.results.format import ResultFormat
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import COVARIANCE_ENTRIES, Layer, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.stored_points import StoredPoints
from posefuse.progress import Progress, Silent, report_ranges

_TYPE = "poses"
_POINTS = ("keypoint", "individual")
_VARIABLES: dict[str, tuple[str, tuple[str, ...], str, type[IntEnum] | None]] = {
    "points_m": ("position", ("time", "space", *_POINTS), "f8", None),
    "covariance_m2": ("covariance", ("time", "covariance_entry", *_POINTS), "f8", None),
    "status": ("status", ("time", *_POINTS), "i1", PointStatus),
    "source": ("source", ("time", *_POINTS), "i1", Source),
    "n_views": ("n_views", ("time", *_POINTS), "i2", None),
    "reprojection_error_px": ("reprojection_error", ("time", *_POINTS), "f8", None),
    "view_status": ("view_status", ("time", "view", *_POINTS), "i1", ViewStatus),
    "view_error_px": ("view_error", ("time", "view", *_POINTS), "f4", None),
}


def write(result: Reconstruction, path: Path, layer: LayerName, progress: Progress | None = None) -> None:
    """Write one layer of all people."""
    has_times = bool(np.isfinite(result.time_s).all())
    parts = report_ranges(result.chunks(), result.n_frames, f"writing {path.name}", progress or Silent())
    with replacing(path) as temporary, OutputFile(temporary) as file:
        _write_head(file, result, layer, has_times)
        start = 0
        for part in parts:
            stop = start + part.n_frames
            file.resize_dimension("time", stop)
            write_rows(file, "time", start, part.time_s if has_times else part.frame_numbers)
            write_rows(file, "frame_number", start, part.frame_numbers)
            shape = part.n_frames, len(part.skeleton), len(part.person_ids)
            # Assigning a scalar would write element by element.
            write_rows(file, "confidence", start, np.full(shape, np.nan))
            for attribute, (name, axes, *_) in _VARIABLES.items():
                write_rows(file, name, start, _transposed(part.layers[layer], attribute, len(axes)))
            start = stop


def _transposed(layer: Layer, attribute: str, axes: int) -> np.ndarray:
    """Convert (frame, person, keypoint, ...) to movement's order of axes."""
    values = np.asarray(getattr(layer, attribute)[:])
    return values.transpose(0, 2, 1) if axes == 3 else values.transpose(0, 3, 2, 1)


def _write_head(file: OutputFile, result: Reconstruction, layer: LayerName, has_times: bool) -> None:
    file.attrs.update({"ds_type": _TYPE, "source_software": "posefuse", "source_file": result.rig.source})
    file.attrs.update({"time_unit": "seconds" if has_times else "frames", "layer": layer, "unit": result.unit})
    if result.rate_hz is not None:
        file.attrs["fps"] = float(result.rate_hz)
    names = {
        "space": ("x", "y", "z"),
        "keypoint": result.skeleton.keypoints,
        "individual": result.person_ids,
        "view": result.rig.names,
        "covariance_entry": COVARIANCE_ENTRIES,
    }
    file.add_dimensions({"time": None, **{axis: len(values) for axis, values in names.items()}})
    add_variable(file, "time", ("time",), dtype="f8" if has_times else "i8")
    add_variable(file, "frame_number", ("time",), dtype="i8")
    for axis, values in names.items():
        add_variable(file, axis, (axis,), np.array(values, dtype=object))
    add_variable(file, "confidence", ("time", *_POINTS), dtype="f8")
    for name, axes, kind, codes in _VARIABLES.values():
        add_variable(file, name, axes, dtype=kind, **_attributes(name, result.unit, codes))


def _attributes(name: str, unit: str, codes: type[IntEnum] | None) -> dict[str, Any]:
    if codes is not None:
        return {
            "flag_values": np.array([code.value for code in codes], dtype=np.int8),
            "flag_meanings": " ".join(code.name.lower() for code in codes),
        }
    return {"units": {"position": unit, "covariance": f"{unit}2", "n_views": "1"}.get(name, "px")}


def matches(path: Path) -> bool:
    """Return whether a file contains 3D poses of movement."""
    try:
        with h5py.File(path, "r") as file:
            return _text(file, "ds_type") == _TYPE
    except (OSError, KeyError, ValueError, RuntimeError):
        return False


def read(path: Path) -> StoredPoints:
    """Read a file that movement or posefuse wrote, with singular or plural dimension names.

    Raises:
        FileError: if it is not such a file, is corrupt, or contains 2D poses.
    """
    must_exist(path, "netCDF file of movement")
    # Read with h5py, because the netCDF library inspects every variable before it opens one.
    with open_hdf5(path, "netCDF file of movement") as file:
        variable: Any = file["position"]
        plural = "keypoints" in file
        keypoint, individual = ("keypoints", "individuals") if plural else _POINTS
        order = ["time", individual, keypoint, "space"]
        axes = [str(scale[0].name).rsplit("/", 1)[-1] for scale in variable.dims]
        if sorted(axes) != sorted(order) or variable.shape[axes.index("space")] != 3:
            raise FileError(f"{path}: expected position over {choices(order)} in 3D, got {choices(axes)}.")
        fps: Any = file.attrs.get("fps")
        return StoredPoints(
            keypoints=strings(file[keypoint]),
            person_ids=strings(file[individual]),
            points_m=np.asarray(variable, dtype=np.float64).transpose([axes.index(axis) for axis in order]),
            unit=_text(file, "unit"),
            layer=_text(file, "layer"),
            rate_hz=None if fps is None else float(np.ravel(fps)[0]),
            **_times(file),
            **_additional_fields(file),
        )


def _text(file: h5py.File, name: str) -> str:
    text: Any = file.attrs.get(name, "")
    return text.decode() if isinstance(text, bytes) else str(text)


def _times(file: h5py.File) -> dict[str, np.ndarray]:
    time = np.asarray(file["time"])
    has_times = _text(file, "time_unit") == "seconds"
    numbers = np.asarray(file["frame_number"]) if "frame_number" in file else None
    if numbers is None:
        numbers = np.arange(len(time)) if has_times else time.astype(np.int64)
    return {"frame_numbers": numbers, "time_s": time if has_times else np.full(len(time), np.nan)}


def _additional_fields(file: h5py.File) -> dict[str, Any]:
    """Return the fields that posefuse adds to movement's."""
    if _text(file, "source_software") != "posefuse":
        return {}
    additional: dict[str, Any] = {"view_names": strings(file["view"])}
    for attribute, (name, axes, *_) in _VARIABLES.items():
        values = np.asarray(file[name])
        additional[attribute] = values.transpose(0, 2, 1) if len(axes) == 3 else values.transpose(0, 3, 2, 1)
    del additional["points_m"]
    return additional


FORMAT = ResultFormat(
    name="movement",
    files="*.nc with position (time, space, keypoint, individual)",
    conventions=("meters, world axes, seconds; confidence is present and NaN; movement before 0.17 uses other names"),
    additional_name="movement.nc",
    endings=(".nc",),
    name_words=("movement",),
    matches=matches,
    read=read,
    write_layer=write,
)
