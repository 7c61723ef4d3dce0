"""Open a stored result."""

from pathlib import Path

from posefuse.io.files import RUN_FILE, must_exist
from posefuse.io.results import netcdf
from posefuse.model.reconstruction import Reconstruction

RESULT_OF_RUN = "result"
"""Folder of the result in the output of ``posefuse run``."""


def result_file(path: Path) -> Path:
    """Return the ``reconstruction.nc`` of a result's folder, or of a run's output; another path as it is."""
    inside = path / RESULT_OF_RUN if (path / RUN_FILE).is_file() else path
    return next((place / "reconstruction.nc" for place in (path, inside) if (place / "reconstruction.nc").is_file()),
                path / "reconstruction.nc" if path.is_dir() else path)  # fmt: skip


def run_of(file: Path) -> Path | None:
    """Return the output of the run that made a ``reconstruction.nc``, or None."""
    above = file.absolute().parent.parent
    return above if file.absolute().parent.name == RESULT_OF_RUN and (above / RUN_FILE).is_file() else None


def open_result(path: Path) -> tuple[Path, Reconstruction]:
    """Open a result by its folder, by its ``reconstruction.nc``, or by the output of the run that made it.

    Returns:
        The path of ``reconstruction.nc`` and the result.

    Raises:
        FileError: if there is no result, or it cannot be read.
    """
    file = result_file(path)
    must_exist(file, "result")
    return file, netcdf.read_reconstruction(file)
