"""Open results."""

from pathlib import Path

from posefuse.io.files import must_exist
from posefuse.io.results import netcdf
from posefuse.model.reconstruction import Reconstruction


def open_result(path: Path) -> tuple[Path, Reconstruction]:
    """Return the file of a result and the result, by its folder or file.

    Raises:
        FileError: if there is no result, or it cannot be read.
    """
    file = path / "reconstruction.nc" if path.is_dir() else path
    must_exist(file, "result")
    return file, netcdf.read_reconstruction(file)
