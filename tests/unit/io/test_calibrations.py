"""Calibration files: conventions, units, order and error messages."""

import re
from dataclasses import replace

import numpy as np
import pytest

from posefuse import read_cameras
from posefuse.errors import CameraError, FileError, PosefuseError
from posefuse.io.calibration import anipose, pose2sim
from posefuse.io.calibration.read import find_format
from posefuse.io.calibration.write import write_like
from posefuse.model.cameras import CameraRig, LensModel
from tests.files import anipose_toml, pose2sim_toml, qualisys_xml
from tests.scenes import ring


def assert_same_cameras(found: CameraRig, expected: CameraRig, atol: float = 1e-12) -> None:
    assert found.names == expected.names
    for a, b in zip(found.cameras, expected.cameras, strict=True):
        np.testing.assert_allclose(a.matrix, b.matrix, atol=atol)
        np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=atol)
        assert (a.lens, a.size_px) == (b.lens, b.size_px)
        np.testing.assert_allclose(a.distortion, b.distortion, atol=atol)


def four_coefficients(rig: CameraRig) -> CameraRig:
    return CameraRig(tuple(replace(c, distortion=(*c.distortion[:4], 0.0)) for c in rig.cameras))


def test_pose2sim(tmp_path):
    path = tmp_path / "Calib.toml"
    rig = four_coefficients(ring(4, "barrel"))
    path.write_text(pose2sim_toml(rig))
    found = read_cameras(path)
    assert_same_cameras(found, rig)
    assert (found.up_axis, found.meters_per_unit, found.source) == ("z", 1.0, "Calib.toml")


def test_qualisys(tmp_path):
    path = tmp_path / "Calib.qca.txt"
    rig = ring(3, "mild")
    path.write_text(qualisys_xml(rig))
    found = read_cameras(path)
    assert_same_cameras(found, rig, 1e-9)
    assert (found.up_axis, found.meters_per_unit) == ("z", 0.001)


def test_qualisys_scales_videos_of_lower_resolution(tmp_path):
    """720 of 1080 lines: as if the images of the calibration had been made smaller."""
    path, rig = tmp_path / "x.qca.txt", ring(2)
    path.write_text(qualisys_xml(rig).replace('viewrotation="0"', 'viewrotation="0" video_resolution="720p"'))
    for found, camera in zip(read_cameras(path).cameras, rig.cameras, strict=True):
        assert found.size_px == (1280, 720)
        points = np.random.default_rng(0).normal((0.0, 0.0, 1.0), 0.3, (20, 3))
        np.testing.assert_allclose(
            found.project(points)[0], (camera.project(points)[0] + 0.5) * (2.0 / 3.0) - 0.5, atol=1e-9
        )
    for same in ("1080p", "N/A"):
        path.write_text(qualisys_xml(rig).replace('viewrotation="0"', f'viewrotation="0" video_resolution="{same}"'))
        np.testing.assert_allclose(read_cameras(path).cameras[1].matrix, rig.cameras[1].matrix)


def test_qualisys_marker_cameras_are_left_out(tmp_path):
    path = tmp_path / "x.qca.txt"
    kinds = iter(["Miqus Video", "Miqus M3", "Miqus Hybrid"])
    text = re.sub('model="none"', lambda _: f'model="{next(kinds)}"', qualisys_xml(ring(3)))
    path.write_text(text)
    found = read_cameras(path)
    assert found.names == ("cam_0", "cam_2")
    assert found.notes == ("x.qca.txt: marker cameras are left out: cam_1.",)
    path.write_text(re.sub('model="[^"]*"', 'model="Oqus 210c"', text))
    assert len(read_cameras(path)) == 3


def test_qualisys_principal_point_is_relative_to_the_video(tmp_path):
    path = tmp_path / "Calib.qca.txt"
    text = qualisys_xml(ring(2)).replace('left="0" top="0" right="1919"', 'left="100" top="0" right="2019"')
    path.write_text(text)
    assert read_cameras(path).cameras[0].matrix[0, 2] == pytest.approx(959.5 - 100)


@pytest.mark.parametrize("lens", ["pinhole", "barrel", "fisheye"])
def test_anipose_in_millimeters(lens, tmp_path):
    path = tmp_path / "calibration.toml"
    rig = ring(3, lens)
    path.write_text(anipose_toml(rig))
    found = read_cameras(path)
    assert_same_cameras(found, rig)
    assert found.up_axis is None
    assert "assumed mm" in found.notes[0]


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
    found = read_cameras(path)
    assert_same_cameras(found, rig)
    assert (found.up_axis, found.notes) == ("z", ())
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


BROKEN = [
    (lambda text: text[: len(text) // 2], FileError, ["is not valid TOML", "truncated"]),
    (lambda text: text.replace("matrix =", "martix ="), FileError, ["[cam_0]", "no matrix", "martix"]),
    (
        lambda text: text.replace("rotation = [", "rotation = [0.0, "),
        FileError,
        ["rotation should hold 3 or 9 numbers, got 4"],
    ),
    (lambda text: text.replace("size = [1920, 1080]", 'size = "HD"'), FileError, ["does not consist of numbers"]),
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


@pytest.mark.parametrize(
    ("break_it", "words"),
    [
        (lambda text: text[:-40], "not complete XML"),
        (lambda text: text.replace("<camera ", "<kamera ").replace("</camera>", "</kamera>"), "has no cameras"),
        (
            lambda text: text.replace('focalLengthU="', 'focalLengthU="x'),
            "intrinsic@focalLengthU should be a number, got 'x",
        ),
        (lambda text: text.replace('<?xml version="1.0"?>', '<!DOCTYPE a [<!ENTITY b "c">]>'), "entities"),
    ],
)
def test_invalid_qualisys_error_names_the_location(break_it, words, tmp_path):
    path = tmp_path / "Calib.qca.txt"
    path.write_text(break_it(qualisys_xml(ring(2))))
    with pytest.raises(FileError, match=words):
        read_cameras(path)


def test_invalid_rotation_is_an_error(tmp_path):
    path = tmp_path / "Calib.qca.txt"
    path.write_text(qualisys_xml(ring(2)).replace('r11="', 'r11="1'))
    with pytest.raises(
        CameraError, match=r"Calib\.qca\.txt: Camera 'cam_0': the rotation matrix is not a proper rotation"
    ):
        read_cameras(path)


def test_other_files_are_not_calibrations(tmp_path):
    with pytest.raises(FileError, match=r"No calibration file at .*contains: "):
        read_cameras(tmp_path / "calibration.toml")
    with pytest.raises(FileError, match="is a folder"):
        read_cameras(tmp_path)
    notes = tmp_path / "notes.txt"
    notes.write_text("hello")
    with pytest.raises(FileError, match=r"not a calibration in a supported format. Supported: caliscope"):
        read_cameras(notes)
    settings = tmp_path / "settings.toml"
    settings.write_text("a = 1")
    with pytest.raises(PosefuseError, match="not a calibration"):
        read_cameras(settings)


def test_failed_write_leaves_no_file(tmp_path, monkeypatch):
    path = tmp_path / "calibration.toml"

    def broken(*_):
        raise RuntimeError("disk full")

    monkeypatch.setattr(anipose.tomli_w, "dumps", broken)
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
    said = write_like(replace(rig, up_axis=up), tmp_path / "refined.toml", original)
    again = read_cameras(tmp_path / "refined.toml")
    assert ("in the format pose2sim" in said) is (up == "z")
    assert find_format(tmp_path / "refined.toml").name == ("pose2sim" if up == "z" else "anipose")
    assert (again.names, again.notes, again.left_out, again.up_axis) == (rig.names, rig.notes, rig.left_out, up)
    assert_same_cameras(again, rig)


def test_unsupported_lenses_are_written_as_anipose(tmp_path):
    pose2sim.write(replace(ring(2), up_axis="z"), tmp_path / "a.toml")
    fish = replace(ring(2, "fisheye"), up_axis="z")
    said = write_like(fish, tmp_path / "b.toml", tmp_path / "a.toml")
    assert "anipose" in said
    assert "k1 k2 p1 p2" in said


def test_qualisys_is_written_as_qualisys(tmp_path):
    rig = replace(ring(3, "mild"), up_axis="z", notes=("Refined & so on.",), left_out=("cam_9",))
    original = tmp_path / "Calib.qca.txt"
    original.write_text(qualisys_xml(rig))
    assert write_like(rig, tmp_path / "b.qca.txt", original) == "in the format qualisys of Calib.qca.txt"
    assert find_format(tmp_path / "b.qca.txt").name == "qualisys"
    assert write_like(rig, tmp_path / "b.toml", original).startswith("in the format anipose: ")
    for name in ("b.qca.txt", "b.toml"):
        again = read_cameras(tmp_path / name)
        assert (again.names, again.notes, again.left_out, again.up_axis) == (rig.names, rig.notes, rig.left_out, "z")
        assert_same_cameras(again, rig)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"up_axis": "y"}, "requires the up axis z, but it is y"),
        ({"cameras": ring(2, "fisheye").cameras}, "has others"),
        ({"cameras": (replace(ring(2).cameras[0], name="a\x01"),)}, "does not allow some characters"),
    ],
)
def test_rig_that_qualisys_cannot_represent_is_an_error(change, why, tmp_path):
    rig = replace(replace(ring(2), up_axis="z"), **change)
    original = tmp_path / "Calib.qca.txt"
    original.write_text(qualisys_xml(ring(2)))
    with pytest.raises(FileError, match=why):
        write_like(rig, tmp_path / "b.qca.txt", original)
    assert not (tmp_path / "b.qca.txt").exists()


def test_name_with_a_wrong_ending_is_an_error(tmp_path):
    (tmp_path / "Calib.qca.txt").write_text(qualisys_xml(ring(2)))
    with pytest.raises(FileError, match=r"the name of the calibration must end in \.qca\.txt, \.qca\.xml, \.toml"):
        write_like(ring(2), tmp_path / "refined", tmp_path / "Calib.qca.txt")
