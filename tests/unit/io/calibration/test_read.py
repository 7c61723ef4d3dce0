"""Reading of calibrations: errors and the choice of a format."""

import pytest

from posefuse import read_cameras
from posefuse.errors import CameraError, FileError, PosefuseError
from tests.files import anipose_toml, qualisys_xml
from tests.scenes import ring

BROKEN = [
    (lambda text: text[: len(text) // 2], FileError, ["is not valid TOML", "truncated"]),
    (lambda text: text.replace("matrix =", "martix ="), FileError, ["[cam_0]", "no matrix", "martix"]),
    (
        lambda text: text.replace("rotation = [", "rotation = [0.0, "),
        FileError,
        ["rotation must contain 3 or 9 numbers, got 4"],
    ),
    (lambda text: text.replace("size = [1920, 1080]", 'size = "HD"'), FileError, ["size must consist of numbers"]),
    (lambda text: text.replace("1200.0", "0.0"), CameraError, ["'cam_0'", "focal lengths must be positive"]),
    (lambda text: text.replace("1200.0", "nan"), CameraError, ["not finite"]),
    (lambda text: text.replace("[metadata]", '[metadata]\nunit = "inch"'), FileError, ["metadata.unit is 'inch'"]),
    (lambda text: text.replace("[metadata]", '[metadata]\nup_axis = "up"'), FileError, ["metadata.up_axis is 'up'"]),
    (lambda text: text.replace('"cam_1"', '"cam_0"'), CameraError, ["repeats cam_0"]),
]


@pytest.mark.parametrize(("break_it", "kind", "words"), BROKEN)
def test_invalid_calibration_error_names_the_location(break_it, kind, words, tmp_path):
    path = tmp_path / "calibration.toml"
    path.write_text(break_it(anipose_toml(ring(3))))
    with pytest.raises(kind) as error:
        read_cameras(path)
    for word in [*words, "calibration.toml"]:
        assert word in str(error.value)


def test_invalid_rotation_is_an_error(tmp_path):
    path = tmp_path / "Calib.qca.txt"
    path.write_text(qualisys_xml(ring(2)).replace('r11="', 'r11="1'))
    with pytest.raises(
        CameraError, match=r"Calib\.qca\.txt: Camera 'cam_0': the rotation matrix is not a proper rotation"
    ):
        read_cameras(path)


def test_other_files_are_not_calibrations(tmp_path):
    with pytest.raises(FileError, match=r"No calibration file at .* is empty"):
        read_cameras(tmp_path / "calibration.toml")
    with pytest.raises(FileError, match="is a folder"):
        read_cameras(tmp_path)
    notes = tmp_path / "notes.txt"
    notes.write_text("hello")
    with pytest.raises(FileError, match=r"not a calibration in a supported format. Supported: caliscope"):
        read_cameras(notes)
    (tmp_path / "cam_1.mp4").write_bytes(b"")
    with pytest.raises(FileError, match="is a video, not a calibration"):
        read_cameras(tmp_path / "cam_1.mp4")
    settings = tmp_path / "settings.toml"
    settings.write_text("a = 1")
    with pytest.raises(PosefuseError, match="not a calibration"):
        read_cameras(settings)
