"""Writing of calibrations."""

from dataclasses import replace

import pytest

from posefuse import read_cameras
from posefuse.errors import FileError
from posefuse.io.calibration import anipose, covariances, pose2sim
from posefuse.io.calibration.read import find_format
from posefuse.io.calibration.write import write_like
from posefuse.model.cameras import LensModel
from tests.camera_checks import assert_same_cameras, four_coefficients
from tests.files import qualisys_xml
from tests.scenes import ring


def test_failed_write_leaves_no_file(tmp_path, monkeypatch):
    path = tmp_path / "calibration.toml"

    def broken(*_):
        raise RuntimeError("disk full")

    monkeypatch.setattr(covariances.tomli_w, "dumps", broken)
    with pytest.raises(RuntimeError):
        anipose.write(ring(2), path)
    assert list(tmp_path.iterdir()) == []


def test_lens_models_round_trip():
    assert ring(2, "fisheye").cameras[0].lens is LensModel.FISHEYE


@pytest.mark.parametrize("up", ["z", None])
def test_calibration_is_written_in_the_format_of_the_original(up, tmp_path):
    rig = replace(four_coefficients(ring(3, "mild")), up_axis="z", notes=("Refined.",), left_out=("cam_9",))
    original = tmp_path / "Calib.toml"
    pose2sim.write(rig, original)
    messages = write_like(replace(rig, up_axis=up), tmp_path / "refined.toml", original)
    again = read_cameras(tmp_path / "refined.toml")
    assert ("in the format pose2sim" in messages) is (up == "z")
    assert find_format(tmp_path / "refined.toml").name == ("pose2sim" if up == "z" else "anipose")
    assert (again.names, again.notes, again.left_out, again.up_axis) == (rig.names, rig.notes, rig.left_out, up)
    assert_same_cameras(again, rig)


def test_unsupported_lenses_are_written_as_anipose(tmp_path):
    pose2sim.write(replace(ring(2), up_axis="z"), tmp_path / "a.toml")
    fish = replace(ring(2, "fisheye"), up_axis="z")
    messages = write_like(fish, tmp_path / "b.toml", tmp_path / "a.toml")
    assert "anipose" in messages
    assert "k1 k2 p1 p2" in messages


def test_name_with_a_wrong_ending_is_an_error(tmp_path):
    (tmp_path / "Calib.qca.txt").write_text(qualisys_xml(ring(2)))
    with pytest.raises(FileError, match=r"the name of the calibration must end in \.qca\.txt, \.qca\.xml, \.toml"):
        write_like(ring(2), tmp_path / "refined", tmp_path / "Calib.qca.txt")
