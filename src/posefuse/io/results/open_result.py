"""Open a stored result."""

from pathlib import Path

from posefuse.io.files import must_exist
from posefuse.io.results import netcdf
from posefuse.model.reconstruction import Reconstruction


def open_result(path: Path) -> tuple[Path, Reconstruction]:
    """Open a result by its folder or by its ``reconstruction.nc``.

    Returns:
        The path of ``reconstruction.nc`` and the result.

    Raises:
        FileError: if there is no result, or it cannot be read.
    """
    file = path / "reconstruction.nc" if path.is_dir() else path
    must_exist(file, "result")
    return file, netcdf.read_reconstruction(file)
