"""Covariances of cameras in calibrations."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from posefuse import read_cameras
from posefuse.errors import FileError
from posefuse.io.calibration import anipose
from posefuse.model.camera_covariance import ROTATION, CameraCovariance
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
