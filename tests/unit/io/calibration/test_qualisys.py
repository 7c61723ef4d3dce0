"""Qualisys calibrations."""

import re
from dataclasses import replace

import numpy as np
import pytest

from posefuse import read_cameras
from posefuse.errors import FileError
from posefuse.io.calibration.read import find_format
from posefuse.io.calibration.write import write_like
from tests.camera_checks import assert_same_cameras
from tests.files import qualisys_xml
from tests.scenes import ring


def test_qualisys(tmp_path):
    path = tmp_path / "Calib.qca.txt"
    rig = ring(3, "mild")
    path.write_text(qualisys_xml(rig))
    read_rig = read_cameras(path)
    assert_same_cameras(read_rig, rig, 1e-9)
    assert (read_rig.up_axis, read_rig.meters_per_unit) == ("z", 0.001)


def test_qualisys_scales_videos_of_lower_resolution(tmp_path):
    """720 of 1080 lines: as if the images of the calibration had been made smaller."""
    path, rig = tmp_path / "x.qca.txt", ring(2)
    path.write_text(qualisys_xml(rig).replace('viewrotation="0"', 'viewrotation="0" video_resolution="720p"'))
    for actual, camera in zip(read_cameras(path).cameras, rig.cameras, strict=True):
        assert actual.size_px == (1280, 720)
        points = np.random.default_rng(0).normal((0.0, 0.0, 1.0), 0.3, (20, 3))
        np.testing.assert_allclose(
            actual.project(points)[0], (camera.project(points)[0] + 0.5) * (2.0 / 3.0) - 0.5, atol=1e-9
        )
    for same in ("1080p", "N/A"):
        path.write_text(qualisys_xml(rig).replace('viewrotation="0"', f'viewrotation="0" video_resolution="{same}"'))
        np.testing.assert_allclose(read_cameras(path).cameras[1].matrix, rig.cameras[1].matrix)


def test_qualisys_marker_cameras_are_left_out(tmp_path):
    path = tmp_path / "x.qca.txt"
    kinds = iter(["Miqus Video", "Miqus M3", "Miqus Hybrid"])
    text = re.sub('model="none"', lambda _: f'model="{next(kinds)}"', qualisys_xml(ring(3)))
    path.write_text(text)
    rig = read_cameras(path)
    assert rig.names == ("cam_0", "cam_2")
    assert rig.notes == ("x.qca.txt: marker cameras are left out: cam_1.",)
    path.write_text(re.sub('model="[^"]*"', 'model="Oqus 210c"', text))
    assert len(read_cameras(path)) == 3


def test_qualisys_principal_point_is_relative_to_the_video(tmp_path):
    path = tmp_path / "Calib.qca.txt"
    text = qualisys_xml(ring(2)).replace('left="0" top="0" right="1919"', 'left="100" top="0" right="2019"')
    path.write_text(text)
    assert read_cameras(path).cameras[0].matrix[0, 2] == pytest.approx(959.5 - 100)


@pytest.mark.parametrize(
    ("break_it", "words"),
    [
        (lambda text: text[:-40], "not complete XML"),
        (lambda text: text.replace("<camera ", "<kamera ").replace("</camera>", "</kamera>"), "has no cameras"),
        (
            lambda text: text.replace('focalLengthU="', 'focalLengthU="x'),
            "intrinsic@focalLengthU must be a number, got 'x",
        ),
        (lambda text: text.replace('<?xml version="1.0"?>', '<!DOCTYPE a [<!ENTITY b "c">]>'), "entities"),
    ],
)
def test_invalid_qualisys_error_names_the_location(break_it, words, tmp_path):
    path = tmp_path / "Calib.qca.txt"
    path.write_text(break_it(qualisys_xml(ring(2))))
    with pytest.raises(FileError, match=words):
        read_cameras(path)


def test_qualisys_is_written_as_qualisys(tmp_path):
    rig = replace(ring(3, "mild"), up_axis="z", notes=("Refined & so on.",), left_out=("cam_9",))
    original = tmp_path / "Calib.qca.txt"
    original.write_text(qualisys_xml(rig))
    assert write_like(rig, tmp_path / "b.qca.txt", original) == "in the format qualisys of Calib.qca.txt"
    assert find_format(tmp_path / "b.qca.txt").name == "qualisys"
    assert write_like(rig, tmp_path / "b.toml", original).startswith("in the format anipose (")
    for name in ("b.qca.txt", "b.toml"):
        again = read_cameras(tmp_path / name)
        assert (again.names, again.notes, again.left_out, again.up_axis) == (rig.names, rig.notes, rig.left_out, "z")
        assert_same_cameras(again, rig)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"up_axis": "y"}, "requires the up axis z, but it is y"),
        ({"cameras": ring(2, "fisheye").cameras}, "has other distortion coefficients"),
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
