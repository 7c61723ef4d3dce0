"""The group ``posefuse`` of HDF5 files, with the fields that the format itself cannot hold.

Attributes ``layer``, ``unit``, ``rate_hz``; names ``keypoints``, ``people``, ``views`` and ``edges`` (edge, 2);
``frame_number`` and ``time_s`` (frame); ``covariance`` (frame, person, keypoint, 6: xx xy xz yy yz zz), ``status``,
``source``, ``reprojection_error_px`` (frame, person, keypoint), ``view_status``, ``view_error_px`` (..., view). The
attributes ``flag_values`` and ``flag_meanings`` list the codes. Other programs ignore the group.
"""

from enum import IntEnum
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from posefuse.arrays import ArraySource, ranges
from posefuse.errors import FileError, choices
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.stored_points import StoredPoints

GROUP = "posefuse"
VERSION = 1

_FIELDS: dict[str, tuple[str, type[IntEnum] | None]] = {
    "covariance": ("covariance_m2", None),
    "status": ("status", PointStatus),
    "source": ("source", Source),
    "reprojection_error_px": ("reprojection_error_px", None),
    "view_status": ("view_status", ViewStatus),
    "view_error_px": ("view_error_px", None),
}


def write_group(file: h5py.File, result: Reconstruction, name: LayerName) -> None:
    """Write the group of one layer, by ranges of frames."""
    group, layer = file.create_group(GROUP), result.layers[name]
    group.attrs.update({"version": VERSION, "layer": name, "unit": result.unit})
    if result.rate_hz is not None:
        group.attrs["rate_hz"] = float(result.rate_hz)
    add_names(group, "keypoints", result.skeleton.keypoints)
    add_names(group, "people", result.person_ids)
    add_names(group, "views", result.rig.names)
    group["edges"] = result.skeleton.edge_indices
    group["frame_number"] = result.frame_numbers
    group["time_s"] = result.time_s
    for key, (attribute, codes) in _FIELDS.items():
        data = add_rows(group, key, getattr(layer, attribute))
        if codes is not None:
            data.attrs["flag_values"] = np.array([code.value for code in codes], dtype=np.int8)
            data.attrs["flag_meanings"] = " ".join(code.name.lower() for code in codes)


def add_names(group: h5py.Group, key: str, names: tuple[str, ...]) -> None:
    """Write a list of strings."""
    group.create_dataset(key, data=np.array(names, dtype=object), dtype=h5py.string_dtype())


def add_rows(group: h5py.Group, key: str, source: ArraySource) -> h5py.Dataset:
    """Write an array by ranges of its first axis, with compression, and return the dataset."""
    shape = tuple(source.shape)
    layout: dict[str, Any] = {}
    if all(shape):
        chunks = (min(CHUNK_FRAMES, shape[0]), *shape[1:])
        layout = {"chunks": chunks, "compression": "gzip", "compression_opts": 1, "shuffle": True}
    data = group.create_dataset(key, shape, source.dtype, **layout)
    for start, stop in ranges(shape[0], CHUNK_FRAMES):
        data[start:stop] = np.asarray(source[start:stop])
    return data


def read_names(group: h5py.Group, key: str) -> tuple[str, ...]:
    """Read a list of strings."""
    return tuple(each.decode() if isinstance(each, bytes) else str(each) for each in np.asarray(group[key]).tolist())


def read_group(file: h5py.File, path: Path, points: np.ndarray) -> StoredPoints:
    """Read the group, combined with the points that are stored elsewhere in the file.

    Args:
        file: an open file with the group.
        path: path of the file.
        points: shape (row, person, keypoint, 3), one row per frame number, starting with that of the first frame.

    Raises:
        FileError: if the group and the points are inconsistent.
    """
    group: Any = file[GROUP]
    frame_numbers = np.asarray(group["frame_number"])
    row_indices = frame_numbers - frame_numbers[:1]
    if len(frame_numbers) == 0 or (np.diff(row_indices) <= 0).any() or row_indices[-1] + 1 != len(points):
        raise FileError(
            f"{path}: {len(points)} rows are inconsistent with the {len(frame_numbers)} frames of its group {GROUP!r}."
        )
    _check_codes(group, path)
    return StoredPoints(
        keypoints=read_names(group, "keypoints"),
        person_ids=read_names(group, "people"),
        frame_numbers=frame_numbers,
        time_s=np.asarray(group["time_s"]),
        points_m=points[row_indices],
        unit=str(group.attrs["unit"]),
        layer=str(group.attrs["layer"]),
        rate_hz=float(group.attrs["rate_hz"]) if "rate_hz" in group.attrs else None,
        view_names=read_names(group, "views"),
        **{attribute: np.asarray(group[key]) for key, (attribute, _) in _FIELDS.items()},
    )


def _check_codes(group: Any, path: Path) -> None:
    for key, (_, codes) in _FIELDS.items():
        present = set() if codes is None else set(np.unique(np.asarray(group[key])).tolist())
        unknown = sorted(present - {code.value for code in codes or ()})
        if unknown:
            raise FileError(f"{path}: {GROUP}/{key} contains unknown codes: {choices(unknown)}.")
