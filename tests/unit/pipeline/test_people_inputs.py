"""Lenses of a calibration by people: given, guessed, or of unknown image size."""

import numpy as np
import pytest

from posefuse.errors import CalibrationError
from posefuse.model.options.calibration import PeopleOptions
from posefuse.pipeline.people_inputs import cameras_of
from posefuse.synthetic.rigs import build_rig
from tests.videos import SIZE_PX, coded_video

RIG = build_rig("ring", 3, "barrel")


def test_known_lenses_are_used_without_their_poses():
    names = tuple(f"{name}_json" for name in RIG.names)
    cameras, known = cameras_of(names, RIG, None, PeopleOptions())
    assert known == (True, True, True)
    for camera, given in zip(cameras, RIG.cameras, strict=True):
        assert camera.name == given.name
        assert camera.distortion == given.distortion
        assert np.array_equal(camera.camera_from_world, np.eye(4))


def test_a_missing_lens_is_guessed_from_the_image_size():
    cameras, known = cameras_of(("left", RIG.names[0]), RIG, None, PeopleOptions(image_size=(1920, 1080)))
    assert known == (False, True)
    assert cameras[0].size_px == (1920, 1080)
    assert cameras[0].matrix[0, 2] == pytest.approx(959.5)
    assert cameras[0].matrix[0, 0] == cameras[0].matrix[1, 1] > 960


def test_image_sizes_come_from_videos_of_the_same_name(tmp_path):
    (tmp_path / "videos").mkdir()
    coded_video(tmp_path / "videos" / "left.mp4")
    cameras, _ = cameras_of(("left",), None, tmp_path, PeopleOptions())
    assert cameras[0].size_px == SIZE_PX


def test_all_views_of_unknown_size_are_named():
    with pytest.raises(CalibrationError, match="left.*right"):
        cameras_of(("left", "right"), None, None, PeopleOptions())
