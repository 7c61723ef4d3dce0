"""Anipose calibrations."""

import numpy as np
import pytest

from posefuse import read_cameras
from posefuse.io.calibration import anipose
from tests.camera_checks import assert_same_cameras
from tests.files import anipose_toml
from tests.scenes import ring


@pytest.mark.parametrize("lens", ["pinhole", "barrel", "fisheye"])
def test_anipose_in_millimeters(lens, tmp_path):
    path = tmp_path / "calibration.toml"
    rig = ring(3, lens)
    path.write_text(anipose_toml(rig))
    read_rig = read_cameras(path)
    assert_same_cameras(read_rig, rig)
    assert read_rig.up_axis is None
    assert "assumed mm" in read_rig.notes[0]


def test_anipose_orders_cameras_by_number(tmp_path):
    """As text cam_10 comes before cam_2."""
    path = tmp_path / "calibration.toml"
    rig = ring(12)
    path.write_text(anipose_toml(rig))
    assert read_cameras(path).names == rig.names


def test_anipose_in_meters(tmp_path):
    path = tmp_path / "calibration.toml"
    rig = ring(3)
    path.write_text(anipose_toml(rig, unit_per_m=1.0))
    assert_same_cameras(read_cameras(path), rig)
    assert_same_cameras(read_cameras(path, length_unit="m"), rig)
    assert read_cameras(path, length_unit="m").notes == ()
    in_mm = read_cameras(path, length_unit="mm")
    np.testing.assert_allclose(in_mm.cameras[0].center_m, rig.cameras[0].center_m / 1000, atol=1e-12)


def test_anipose_metadata_round_trips(tmp_path):
    path = tmp_path / "calibration.toml"
    rig = ring(3, "barrel")
    anipose.write(rig, path)
    read_rig = read_cameras(path)
    assert_same_cameras(read_rig, rig)
    assert (read_rig.up_axis, read_rig.notes) == ("z", ())
    assert read_cameras(path, up="y").up_axis == "y"


def test_freemocap_ground_plane_means_z_up(tmp_path):
    path = tmp_path / "calibration.toml"
    text = anipose_toml(ring(3)).replace("adjusted = false", "groundplane_calibration = true")
    path.write_text(text)
    assert read_cameras(path).up_axis == "z"


def test_rotation_matrix(tmp_path):
    path = tmp_path / "calibration.toml"
    rig = ring(2)
    text = anipose_toml(rig)
    for camera, line in zip(
        rig.cameras, [line for line in text.splitlines() if line.startswith("rotation")], strict=True
    ):
        text = text.replace(line, f"rotation = {camera.rotation.tolist()}")
    path.write_text(text)
    assert_same_cameras(read_cameras(path), rig)
