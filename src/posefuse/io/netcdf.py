"""What the netCDF-4 files share: arrays read by ranges, appended ranges, and nouns as text."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

import h5netcdf
import h5py
import numpy as np

from posefuse.arrays import frozen
from posefuse.errors import FileError
from posefuse.io.files import must_be_texts, reading
from posefuse.io.hdf5 import check_ranged
from posefuse.skeleton.parts import Part
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import ADULT_M, Limit, Node, Tree

CHUNK_FRAMES = 256
"""Frames that are compressed together."""


class StoredArray:
    """A variable of a netCDF file, read by ranges; the file is open only while it reads."""

    def __init__(self, path: Path, name: str) -> None:
        self._path = path
        self._name = name
        with h5py.File(path, "r") as file:
            variable: Any = file[name]
            self.shape: tuple[int, ...] = tuple(variable.shape)
            self.dtype: np.dtype[Any] = np.dtype(variable.dtype)

    def __getitem__(self, key: Any) -> np.ndarray:
        if isinstance(key, int) and not -len(self) <= key < len(self):
            raise IndexError(f"{self!r} has no {key}.")
        # Past the netCDF library, which looks at every variable of the file before it opens one.
        with reading(self._path, "netCDF-4 file"), h5py.File(self._path, "r") as file:
            variable: Any = file[self._name]
            return np.asarray(variable[key])

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        return f"StoredArray({self._path.name}:{self._name}, shape={self.shape}, dtype={self.dtype})"


def open_file(path: Path, kind: str) -> h5netcdf.File:
    """Open a netCDF file that posefuse wrote.

    Raises:
        FileError: if it is not netCDF-4, is cut short, or holds something else than ``kind``.
    """
    if h5py.is_hdf5(path):
        check_ranged(path, "netCDF-4 file")
    try:
        file = h5netcdf.File(path, "r")
    except Exception as error:  # a broken file raises whatever its bytes lead to
        if path.suffix != ".nc":
            raise FileError(f"{path} is no {kind} file of posefuse's, which end in .nc.") from None
        raise FileError(f"{path} is not a netCDF-4 file that can be read: {error}. Was it cut short?") from None
    with reading(path, "netCDF-4 file"):
        found = file.attrs.get("posefuse_kind")
    if found != kind:
        file.close()
        raise FileError(f"{path} is a netCDF file, but not {kind} of posefuse's (posefuse_kind is {found!r}).")
    return file


def text_of(file: h5netcdf.File, name: str) -> str:
    """A text attribute of a file."""
    return str(_attribute(file, name))


def number_of(file: h5netcdf.File, name: str) -> float:
    """A number attribute of a file."""
    return float(_attribute(file, name))


def _attribute(file: h5netcdf.File, name: str) -> Any:
    if name not in file.attrs:
        raise FileError(
            f"{file.filename} does not say its {name}: another version of posefuse wrote it, or it was changed. Make "
            "it anew from the recording."
        )
    return cast("Any", file.attrs[name])


def add_variable(
    file: h5netcdf.File,
    name: str,
    dimensions: tuple[str, ...],
    data: np.ndarray | None = None,
    dtype: Any = None,
    **attributes: Any,
) -> Any:
    """Create a variable over existing dimensions, compressed along the first; strings are kept as strings."""
    if data is not None and np.asarray(data).dtype.kind in "UO":
        variable = file.create_variable(name, dimensions, dtype=h5py.string_dtype())
        must_be_texts(np.asarray(data).ravel().tolist())
        variable[...] = np.asarray(data, dtype=object)
    else:
        kind = dtype if data is None else np.asarray(data).dtype
        sizes = [file.dimensions[d].size for d in dimensions]
        growing = bool(dimensions) and file.dimensions[dimensions[0]].isunlimited()
        packed: dict[str, Any] = {}
        if growing or (sizes and sizes[0] > CHUNK_FRAMES):
            chunks = (CHUNK_FRAMES, *(max(size, 1) for size in sizes[1:]))
            packed = {"chunks": chunks, "compression": "gzip", "compression_opts": 1, "shuffle": True}
        variable = file.create_variable(name, dimensions, dtype=kind, **packed)
        if data is not None:
            variable[...] = data
    for key, value in attributes.items():
        variable.attrs[key] = value
    return variable


def strings(variable: Any) -> tuple[str, ...]:
    """The strings of a variable."""
    return tuple(v.decode() if isinstance(v, bytes) else str(v) for v in np.asarray(variable[...]).ravel())


def skeleton_text(skeleton: Skeleton) -> str:
    """A skeleton as JSON."""
    return json.dumps(asdict(skeleton), separators=(",", ":"), default=np.ndarray.tolist)


def skeleton_from_text(text: str) -> Skeleton:
    """The skeleton of :func:`skeleton_text`."""
    data: Mapping[str, Any] = json.loads(text)

    def pairs(rows: list[list[str]]) -> tuple[tuple[str, str], ...]:
        return tuple((a, b) for a, b in rows)

    return Skeleton(
        name=data["name"],
        keypoints=tuple(data["keypoints"]),
        edges=pairs(data["edges"]),
        pairs=pairs(data["pairs"]),
        chains={limb: pairs(rows) for limb, rows in data["chains"].items()},
        derived={name: tuple(parts) for name, parts in data["derived"].items()},
        plausible_m=tuple((a, b, low, high) for a, b, low, high in data["plausible_m"]),
        names={program: tuple(names) for program, names in data["names"].items()},
        description=data["description"],
        core=tuple(data.get("core", ())),
        tree=None if data.get("tree") is None else _tree(data["tree"]),
        parts=tuple(
            Part(part["name"], part["at"], part["like"], frozen(part["keypoints"], np.int64), _tree(part["tree"]))
            for part in data.get("parts", ())
        ),
        rigid=pairs(data.get("rigid", ())),
    )


def _tree(data: Mapping[str, Any]) -> Tree:
    def record(kind: Any, values: Mapping[str, Any]) -> Any:
        return kind(**{name: tuple(v) if isinstance(v, list) else v for name, v in values.items()})

    return Tree(
        segments=tuple(data["segments"]),
        bones=tuple(data["bones"]),
        nodes=tuple(record(Node, node) for node in data["nodes"]),
        limits=tuple(record(Limit, limit) for limit in data["limits"]),
        shape_names=tuple(data["shape_names"]),
        shape_m=frozen(data["shape_m"]),
        shape_covariance=frozen(np.reshape(data["shape_covariance"], (len(data["shape_m"]),) * 2)),
        keypoint_nodes=frozen(data["keypoint_nodes"], np.int64),
        rest=frozen(np.reshape(data["rest"], (-1, 3))),
        size_m=data.get("size_m", ADULT_M),
    )
