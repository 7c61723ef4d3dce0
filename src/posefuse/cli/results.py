"""Opening results as every command does."""

from pathlib import Path

from posefuse.io.files import must_exist
from posefuse.io.results import netcdf
from posefuse.model.reconstruction import Reconstruction


def open_result(path: Path) -> tuple[Path, Reconstruction]:
    """A result by its folder or its file.

    Raises:
        FileError: if there is none, or it cannot be read.
    """
    file = path / "reconstruction.nc" if path.is_dir() else path
    must_exist(file, "result")
    return file, netcdf.read_reconstruction(file)
