"""Results in other programs' formats by the command line: beside a result, and of a stored one."""

import numpy as np
import pytest

import posefuse
from posefuse.cli.convert_result import convert_result
from posefuse.errors import FileError, ResultError


def test_other_formats_are_written_beside_a_result(run, recording, tmp_path, capsys):
    expected = ["parquet", "anipose", "deeplabcut", "sleap", "movement", "npz", "freemocap"]
    code, out, _ = run("reconstruct", recording, "--output", tmp_path / "out", "--verbose", "--also", *expected)
    assert code == 0
    names = ["points.parquet", "anipose.csv", "points_dlc.h5", "points3d.h5", "movement.nc", "points.npz", "freemocap"]
    for name in names:
        assert name in out
        points = posefuse.read_points(tmp_path / "out" / name)
        stored = posefuse.read_reconstruction(tmp_path / "out" / "reconstruction.nc").best_layer()[1]
        np.testing.assert_allclose(points.points_m, stored.points_m[:], rtol=1e-15)
    output = " ".join(out.split())
    assert "TRC, C3D and the other formats contain the layer solved." in output
    assert "note: anipose cannot hold times, status, covariances, which views." in output
    assert max(map(len, out.splitlines())) <= 80
    # Without them they are gone: they were of the result that is replaced.
    code, _, _ = run("reconstruct", recording, "--output", tmp_path / "out", "--overwrite")
    assert code == 0
    assert not any((tmp_path / "out" / name).is_file() for name in names[:-1])
    assert not list((tmp_path / "out" / "freemocap").rglob("*.*"))

    stored = posefuse.read_reconstruction(tmp_path / "out" / "reconstruction.nc")
    convert_result(tmp_path / "out", "parquet", tmp_path / "x.parquet", "measured")
    output = " ".join(capsys.readouterr().out.split())
    assert f"Wrote x.parquet to {tmp_path}" in output
    points = posefuse.read_points(tmp_path / "x.parquet")
    assert points.layer == "measured"
    np.testing.assert_array_equal(points.points_m, stored.layers["measured"].points_m[:])
    with pytest.raises(ResultError, match="has no layer 'model'"):
        convert_result(tmp_path / "out", "parquet", tmp_path / "y.parquet", "model")
    with pytest.raises(ResultError, match="is the result itself"):
        convert_result(tmp_path / "out", "netcdf", tmp_path / "out" / "reconstruction.nc")
    with pytest.raises(ResultError, match="No format 'parqet'. Did you mean 'parquet'"):
        convert_result(tmp_path / "out", "parqet", tmp_path / "y")
    with pytest.raises(FileError, match="No result at"):
        convert_result(tmp_path / "nowhere", "parquet", tmp_path / "y.parquet")
    assert not (tmp_path / "y.parquet").exists()


def test_unknown_format_is_refused(run, recording, tmp_path):
    code, _, err = run("reconstruct", recording, "--output", tmp_path / "out", "--also", "parket")
    assert code == 2
    assert "--also parket: there is no additional format with this name. Did you mean 'parquet'?" in " ".join(
        err.split()
    )
    assert not (tmp_path / "out").exists()
