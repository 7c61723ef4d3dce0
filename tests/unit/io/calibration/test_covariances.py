"""Covariances of cameras in calibrations."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from posefuse import read_cameras
from posefuse.errors import FileError
from posefuse.io.calibration import anipose
from posefuse.model.camera_covariance import ROTATION, CameraCovariance, separated
from tests.scenes import ring


def with_covariances(names):
    rng = np.random.default_rng(0)
    rig = ring(3)
    rig = replace(rig, cameras=tuple(replace(c, name=name) for c, name in zip(rig.cameras, names, strict=True)))
    roots = rng.normal(0.0, 1e-4, (3, 3, 3))
    covariances = tuple(CameraCovariance(n, ROTATION, r @ r.T, names[0]) for n, r in zip(names, roots, strict=True))
    return replace(rig, covariances=covariances[1:])


@pytest.mark.parametrize("names", [("a", "b", "c"), ("cam 1", 'left "2"', "rücken.3")])
def test_covariances_round_trip(names, tmp_path):
    rig, path = with_covariances(names), tmp_path / "calibration.toml"
    anipose.write(rig, path)
    again = read_cameras(path)
    assert again.names == names
    assert again.covariance(names[0]) is None
    for name in names[1:]:
        before, after = rig.covariance(name), again.covariance(name)
        assert before is not None
        assert after is not None
        assert np.array_equal(before.matrix, after.matrix)
        assert (after.parameters, after.reference) == (ROTATION, names[0])


def with_correlation(names):
    """A rig whose cameras have correlated errors."""
    root = np.random.default_rng(1).normal(0.0, 1e-4, (9, 12))
    parameters = [(name, each) for name in names for each in ROTATION]
    covariances, correlation = separated(parameters, root @ root.T, names[0])
    return replace(with_covariances(names), covariances=covariances, correlation=correlation), root @ root.T


def test_correlations_between_cameras_round_trip(tmp_path):
    names, path = ("a", "b", "c"), tmp_path / "calibration.toml"
    rig, matrix = with_correlation(names)
    assert np.allclose(rig.covariance().matrix, matrix, rtol=1e-12)
    anipose.write(rig, path)
    again = read_cameras(path).covariance()
    assert again is not None
    assert again.parameters == tuple((name, each) for name in names for each in ROTATION)
    sd = np.sqrt(np.diag(matrix))
    assert np.abs((again.matrix - matrix) / sd / sd[:, None]).max() < 1e-6
    assert np.array_equal(again.matrix[:3, :3], rig.covariance("a").matrix)
    cross = again.block([("c", ROTATION[0]), ("a", ROTATION[2]), ("a", "k1")])
    assert cross[0, 1] == again.matrix[6, 2]
    assert not cross[2].any()


def test_a_file_without_one_of_the_cameras_keeps_the_correlations_of_the_others(tmp_path):
    rig, matrix = with_correlation(("a", "b", "c"))
    anipose.write(rig.select(("a", "c")), tmp_path / "calibration.toml")
    again = read_cameras(tmp_path / "calibration.toml").covariance()
    assert [camera for camera, _ in again.parameters] == ["a"] * 3 + ["c"] * 3
    assert np.allclose(again.matrix[:3, 3:], matrix[:3, 6:], rtol=1e-5)


def test_correlations_of_other_parameters_are_refused(tmp_path):
    path = tmp_path / "calibration.toml"
    anipose.write(with_correlation(("a", "b", "c"))[0], path)
    text = path.read_text()
    for start, stop in (("[metadata.covariance.c]", None), ('correlation = "', "====")):
        broken = text[: text.index(start)] if stop is None else text.replace(start, start + stop)
        path.write_text(broken)
        with pytest.raises(FileError, match=r"metadata.correlation"):
            read_cameras(path)


def test_cameras_are_the_only_other_tables(tmp_path):
    """Anipose takes every table but [metadata] for a camera."""
    anipose.write(with_covariances(("a", "b", "c")), tmp_path / "calibration.toml")
    assert [*tomllib.loads((tmp_path / "calibration.toml").read_text())] == ["cam_0", "cam_1", "cam_2", "metadata"]


@pytest.mark.parametrize("table", ["3", "{ a = 3 }", "{ a = { parameters = ['x'], matrix = [[1, 2]] } }"])
def test_broken_covariance_is_named(table, tmp_path):
    path = tmp_path / "calibration.toml"
    anipose.write(ring(3), path)
    text = path.read_text().replace("[metadata]", f"[metadata]\ncovariance = {table}")
    path.write_text(text)
    with pytest.raises(FileError, match="covariance"):
        read_cameras(path)
