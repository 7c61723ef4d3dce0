"""Pose2Sim calibrations."""

from posefuse import read_cameras
from tests.camera_checks import assert_same_cameras, four_coefficients
from tests.files import pose2sim_toml
from tests.scenes import ring


def test_pose2sim(tmp_path):
    path = tmp_path / "Calib.toml"
    rig = four_coefficients(ring(4, "barrel"))
    path.write_text(pose2sim_toml(rig))
    read_rig = read_cameras(path)
    assert_same_cameras(read_rig, rig)
    assert (read_rig.up_axis, read_rig.meters_per_unit, read_rig.source) == ("z", 1.0, "Calib.toml")
