"""Shared parts of the netCDF-4 files: arrays read by ranges, variables, and skeletons as text."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal, cast

import h5netcdf
import h5py
import numpy as np

from posefuse.arrays import frozen
from posefuse.errors import FileError
from posefuse.io.files import check_texts, reading
from posefuse.io.hdf5 import check_ranged
from posefuse.lazy_array import LazyArray, as_array
from posefuse.skeleton.parts import Part
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import ADULT_M, Limit, Node, Tree

CHUNK_FRAMES = 256
"""Number of frames per compressed chunk."""


_SEPARATE, _POINT_AXES = ("space", "covariance_entry", "view"), 3
"""Last axes whose elements are compressed separately in arrays with more axes than frame, person and keypoint."""


class OutputFile(h5netcdf.File):
    """A netCDF file to write, whose variables stay open in HDF5 until it is closed.

    HDF5 allocates some parts of a variable when its last handle is closed. Another thread that samples the stack of
    this one, such as a profiler, can keep a handle open for a moment, and the bytes of the file would depend on that.

    Args:
        path: the file.
        mode: "w" to create it, or "r+" to add to it.
    """

    def __init__(self, path: Path, mode: Literal["w", "r+"] = "w") -> None:
        self._handles: list[Any] = []
        # By default, each open variable would keep a megabyte of chunks that are written already.
        super().__init__(path, mode, rdcc_nbytes=0)
        for name in (*self.dimensions, *self.variables):
            self._keep_open(name)

    def create_variable(self, name: str, *arguments: Any, **more: Any) -> Any:
        """Create a variable, with the arguments of h5netcdf, and keep it open."""
        variable = super().create_variable(name, *arguments, **more)
        self._keep_open(name)
        return variable

    def add_dimensions(self, sizes: Mapping[str, int | None]) -> None:
        """Add dimensions of these sizes, None for one that grows."""
        for name, size in sizes.items():
            self.dimensions[name] = size
            self._keep_open(name)
        # A variable replaces the dataset of a dimension of the same name, whose bytes remain in the file. They are
        # written here, since later they would be written only if this process also reads the file and so flushes it.
        cast("h5py.File", self._h5file).flush()

    def _keep_open(self, name: str) -> None:
        """Keep open the HDF5 dataset of a variable, or that of a dimension without a variable."""
        self._handles.append(cast("h5py.File", self._h5file)[name])


class StoredArray(LazyArray):
    """A variable of a netCDF file that is read by ranges. The file is open only during a read.

    Args:
        path: The file.
        name: Name of the variable.
        dtype: Type of the elements in memory; None for that in the file.
    """

    def __init__(self, path: Path, name: str, dtype: Any = None) -> None:
        self._path = path
        self._name = name
        with h5py.File(path, "r") as file:
            variable: Any = file[name]
            super().__init__(variable.shape, dtype or variable.dtype)

    def read_rows(self, start: int, stop: int) -> np.ndarray:
        """Read rows."""
        # h5py instead of h5netcdf, which inspects every variable of the file when it opens it.
        with reading(self._path, "netCDF-4 file"), h5py.File(self._path, "r") as file:
            variable: Any = file[self._name]
            return np.asarray(variable[start:stop], dtype=self.dtype)

    def __repr__(self) -> str:
        return f"StoredArray({self._path.name}:{self._name}, shape={self.shape}, dtype={self.dtype})"


def stored_array(path: Path, name: str, dtype: Any = None) -> np.ndarray:
    """Return a variable of a netCDF file, read when it is used, as an array of the given type."""
    return as_array(StoredArray(path, name, dtype))


def open_file(path: Path, kind: str) -> h5netcdf.File:
    """Open a netCDF file written by posefuse.

    Args:
        path: The file.
        kind: Expected value of its attribute ``posefuse_kind``.

    Raises:
        FileError: If the file is not netCDF-4, is broken, or is of another kind.
    """
    if h5py.is_hdf5(path):
        check_ranged(path, "netCDF-4 file")
    try:
        file = h5netcdf.File(path, "r")
    except Exception as error:  # a broken file can raise any exception
        if path.suffix != ".nc":
            raise FileError(f"{path} is not a posefuse {kind} file; the names of such files end in .nc.") from None
        raise FileError(f"{path} is not a readable netCDF-4 file: {error}. Is the file truncated?") from None
    with reading(path, "netCDF-4 file"):
        stored_kind = file.attrs.get("posefuse_kind")
    if stored_kind != kind:
        file.close()
        raise FileError(f"{path} is a netCDF file, but not a posefuse {kind} file (posefuse_kind is {stored_kind!r}).")
    return file


def text_of(file: h5netcdf.File, name: str) -> str:
    """Return a text attribute of a file.

    Raises:
        FileError: If the file does not have it.
    """
    return str(_attribute(file, name))


def number_of(file: h5netcdf.File, name: str) -> float:
    """Return a numeric attribute of a file.

    Raises:
        FileError: If the file does not have it.
    """
    return float(_attribute(file, name))


def _attribute(file: h5netcdf.File, name: str) -> Any:
    if name not in file.attrs:
        raise FileError(
            f"{file.filename} lacks the attribute {name}: another version of posefuse wrote it, or it was modified. "
            "Create it again from the recording."
        )
    return cast("Any", file.attrs[name])


def add_variable(
    file: OutputFile,
    name: str,
    dimensions: tuple[str, ...],
    data: np.ndarray | None = None,
    dtype: Any = None,
    **attributes: Any,
) -> Any:
    """Create a variable over existing dimensions.

    Args:
        file: The file.
        name: Name of the variable.
        dimensions: Names of existing dimensions. Long variables are compressed in chunks along the first; each
            coordinate, covariance entry and view has chunks of its own, because its values resemble each other.
        data: Content, or None to append later. Strings are stored as strings.
        dtype: Type of a variable without data.
        **attributes: Attributes of the variable.

    Raises:
        FileError: If a string cannot be stored.
    """
    if data is not None and np.asarray(data).dtype.kind in "UO":
        variable = file.create_variable(name, dimensions, dtype=h5py.string_dtype())
        check_texts(np.asarray(data).ravel().tolist())
        variable[...] = np.asarray(data, dtype=object)
    else:
        kind = dtype if data is None else np.asarray(data).dtype
        sizes = [file.dimensions[d].size for d in dimensions]
        growing = bool(dimensions) and file.dimensions[dimensions[0]].isunlimited()
        packed: dict[str, Any] = {}
        if growing or (sizes and sizes[0] > CHUNK_FRAMES):
            chunks = (CHUNK_FRAMES, *(max(size, 1) for size in sizes[1:]))
            if len(dimensions) > _POINT_AXES and dimensions[-1] in _SEPARATE:
                chunks = (*chunks[:-1], 1)
            packed = {"chunks": chunks, "compression": "gzip", "compression_opts": 1, "shuffle": True}
        variable = file.create_variable(name, dimensions, dtype=kind, **packed)
        if data is not None:
            variable[...] = data
    if data is not None:
        variable._h5ds.flush()
    for key, value in attributes.items():
        variable.attrs[key] = value
    return variable


def write_rows(file: OutputFile, name: str, start: int, values: np.ndarray) -> None:
    """Write rows of a variable from index ``start`` on; they are in the file in the order in which they are written."""
    variable = file.variables[name]
    variable[start : start + len(values)] = values
    variable._h5ds.flush()


def strings(variable: Any) -> tuple[str, ...]:
    """Return the strings of a variable."""
    return tuple(v.decode() if isinstance(v, bytes) else str(v) for v in np.asarray(variable[...]).ravel())


def skeleton_text(skeleton: Skeleton) -> str:
    """Return a skeleton as JSON."""
    return json.dumps(asdict(skeleton), separators=(",", ":"), default=np.ndarray.tolist)


def skeleton_from_text(text: str) -> Skeleton:
    """Return the skeleton that :func:`skeleton_text` wrote."""
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
