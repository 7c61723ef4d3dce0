"""Read 3D points of any format."""

from pathlib import Path

from posefuse.errors import FileError, ResultError, choices, suggestion
from posefuse.io.files import must_exist
from posefuse.io.formats import by_name
from posefuse.io.hdf5 import check_hdf5
from posefuse.io.results.registry import RESULTS
from posefuse.model.stored_points import StoredPoints

READABLE = ("parquet", "anipose", "deeplabcut", "csv", "npz", "freemocap", "movement", "sleap", "nwb", "trc", "c3d")
"""Formats that are read as points, in the order in which files are tried."""

_HDF5 = (".h5", ".nc", ".nwb")
_SUFFIXES = {
    "parquet": (".parquet",),
    "anipose": (".csv",),
    "deeplabcut": (".csv", ".h5"),
    "csv": (".csv",),
    "npz": (".npz",),
    "freemocap": ("",),
    "movement": (".nc",),
    "sleap": (".h5",),
    "nwb": (".nwb",),
    "trc": (".trc",),
    "c3d": (".c3d",),
}


def read_points(path: str | Path, format: str | None = None) -> StoredPoints:  # noqa: A002
    """Read one layer of 3D points, of a file that posefuse or another program wrote.

    Args:
        path: the file; of ``freemocap`` the folder that ``output_data`` is in.
        format: its format's name, by default what its ending and content say.

    Raises:
        FileError: if there is no such file, it is broken, or of no format that is read.
        ResultError: if there is no format of that name.
    """
    path = Path(path)
    if format is not None and format not in READABLE:
        raise ResultError(f"No format {format!r} of points that is read. {suggestion(format, READABLE)}")
    must_exist(path, "file of 3D points")
    if path.suffix.lower() in _HDF5 and path.is_file():
        check_hdf5(path, "HDF5 file")
    name = format or _recognised(path)
    if name is None:
        hint = "It may be a reconstruction: posefuse.read_reconstruction reads those. " if path.suffix == ".nc" else ""
        raise FileError(f"{path} is of no format of 3D points that is read: {choices(READABLE)}. {hint}".strip())
    found = by_name(RESULTS, name)
    assert found is not None
    try:
        module = found.load()
        read = module.read_points if hasattr(module, "read_points") else module.read
        return read(path)
    except ResultError as error:
        raise FileError(f"{path}: {error}") from None


def holds_points(path: Path) -> bool:
    """Whether a file is of a format of 3D points, by its ending and what it begins with."""
    return _recognised(path) is not None


def _recognised(path: Path) -> str | None:
    for name in READABLE:
        form = by_name(RESULTS, name)
        fits = path.suffix.lower() in _SUFFIXES[name] or (path.is_dir() and name == "freemocap")
        if form is not None and fits and path.is_dir() == (name == "freemocap") and form.load().matches(path):
            return name
    return None
