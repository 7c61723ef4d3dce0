"""Bytes of netCDF files do not depend on who else reads them."""

import h5py
import numpy as np
import pytest

from posefuse.io.netcdf import OutputFile, add_variable, write_rows


def written(path, reads: bool) -> bytes:
    """A file to which dimensions and variables are added while the same process reads it, or not."""
    with OutputFile(path, "w") as file:
        file.add_dimensions({"time": 10, "space": 3})
        add_variable(file, "points", ("time", "space"), dtype="f8")
        write_rows(file, "points", 0, np.arange(30.0).reshape(10, 3))
    with OutputFile(path, "r+") as file:
        file.add_dimensions({"name": 2})
        add_variable(file, "name", ("name",), np.array(["one", "two"], dtype=object))
        add_variable(file, "angles", ("time", "name"), dtype="f4")
        for start in (0, 5):
            if reads:
                with h5py.File(path, "r") as reader:
                    assert reader["points"][start, 0] == 3.0 * start
            write_rows(file, "angles", start, np.full((5, 2), start, dtype=np.float32))
    return path.read_bytes()


@pytest.mark.parametrize("reads", [False, True])
def test_reading_in_the_same_process_does_not_change_a_byte(tmp_path, reads):
    assert written(tmp_path / "file.nc", reads) == written(tmp_path / "again.nc", not reads)
