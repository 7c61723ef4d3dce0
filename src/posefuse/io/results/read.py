"""Read 3D points of any supported format."""

from pathlib import Path

from posefuse.arguments import checked
from posefuse.errors import FileError, ResultError, choices, suggestion
from posefuse.io.files import must_exist
from posefuse.io.hdf5 import check_hdf5
from posefuse.io.results.format import ResultFormat
from posefuse.io.results.registry import RESULTS
from posefuse.model.stored_points import StoredPoints

_HDF5 = (".h5", ".nc", ".nwb")


@checked
def read_points(path: str | Path, format: str | None = None) -> StoredPoints:  # noqa: A002
    """Read one layer of 3D points from a file of posefuse or another program.

    Args:
        path: the file; for ``freemocap``, the folder that contains ``output_data``.
        format: name of the format; by default recognized by ending and content.

    Raises:
        FileError: if there is no such file, it is corrupt, or its format is not supported.
        ResultError: if there is no readable format of that name.
    """
    path = Path(path)
    form = None if format is None else next((each for each in RESULTS if each.name == format and each.read), None)
    if format is not None and form is None:
        raise ResultError(f"Unknown format {format!r} of 3D points. {suggestion(format, _readable())}")
    must_exist(path, "file of 3D points")
    if path.suffix.lower() in _HDF5 and path.is_file():
        check_hdf5(path, "HDF5 file")
    form = form or _find_format(path)
    if form is None or form.read is None:
        hint = "It may be a reconstruction: use posefuse.read_reconstruction. " if path.suffix == ".nc" else ""
        raise FileError(f"{path} is not in a readable format of 3D points ({choices(_readable())}). {hint}".strip())
    try:
        return form.read(path)
    except ResultError as error:
        raise FileError(f"{path}: {error}") from None


def holds_points(path: Path) -> bool:
    """Return whether a file is in a format of 3D points, judged by its ending and content."""
    return _find_format(path) is not None


def _readable() -> list[str]:
    return [form.name for form in RESULTS if form.read]


def _find_format(path: Path) -> ResultFormat | None:
    for form in RESULTS:
        fits = path.is_dir() if form.is_folder else path.suffix.lower() in form.endings and not path.is_dir()
        if form.read is not None and form.matches is not None and fits and form.matches(path):
            return form
    return None
