"""Caliscope calibrations."""

from posefuse import read_cameras
from tests import calibrations
from tests.calibrations import rig_for


def test_caliscope_leaves_out_ignored_and_unposed_cameras(tmp_path):
    path = calibrations.caliscope_old(rig_for("caliscope_old"), tmp_path)
    path.write_text(path.read_text().replace("ignore = false", "ignore = true", 1))
    rig = read_cameras(path)
    assert rig.names == ("cam_1", "cam_2")
    assert "cam_0" in rig.notes[0]


def test_averaged_rotation_vectors_give_a_note(tmp_path):
    path = calibrations.parameter_table(rig_for("parameter_table"), tmp_path)
    assert "biased" in read_cameras(path).notes[0]
