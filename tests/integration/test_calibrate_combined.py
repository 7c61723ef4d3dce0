"""``posefuse calibrate`` with a board and people in one estimate."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.calibration_scores import score_calibration

import posefuse
from posefuse.cli.main import main
from posefuse.errors import CalibrationError, OptionsError
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.model.cameras import CameraRig, rotation_from_vector
from posefuse.model.options.calibration import PeopleOptions
from tests.boards import render, small_rig
from tests.filmed_people import filmed_person

SIZE = 4.0
SPEC = "charuco:6x5,square=320mm"
"""The rendered board, in a world that is as many times larger."""


def large_rig(turned_deg: float = 0.0) -> CameraRig:
    """Three cameras around the place where a person moves; the second is turned."""
    cameras = []
    for v, camera in enumerate(small_rig(3).cameras):
        pose = camera.camera_from_world.copy()
        pose[:3, 3] = SIZE * pose[:3, 3] - pose[:3, :3] @ [0.0, 0.0, 0.9]
        if v == 1:
            pose[:3] = rotation_from_vector(np.array([0.0, np.radians(turned_deg), 0.0])) @ pose[:3]
        cameras.append(replace(camera, camera_from_world=pose))
    return CameraRig(tuple(cameras))


def people(rig: CameraRig) -> posefuse.Detections:
    views = filmed_person(rig, np.random.default_rng(5), duration_s=6.0, sigma_px=2.0).views
    pixels = np.stack([view.keypoints_px[:, 0] for view in views], axis=1)
    skeleton = posefuse.find_skeleton("body_25b")
    return posefuse.Detections.from_dense(skeleton, rig.names, pixels, np.ones(pixels.shape[:3]), rate_hz=30.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Videos of a board in two cameras, keypoints of a person in three, and the lenses."""
    place = tmp_path_factory.mktemp("combined")
    (place / "session").mkdir()
    render(CameraRig(small_rig(3).cameras[:2]), place / "session" / "board")
    native.write(people(large_rig()), place / "session" / "keypoints.nc")
    anipose.write(large_rig(), place / "lenses.toml")
    return place


@pytest.fixture(scope="module")
def result(folder):
    return posefuse.calibrate(folder / "session", SPEC, intrinsics=folder / "lenses.toml")


def test_the_board_gives_the_scale_and_people_connect_the_third_camera(result):
    assert isinstance(result, posefuse.PeopleCalibration)
    assert len(result.rig) == 3
    score = score_calibration(result.rig, large_rig())
    assert score.scale == pytest.approx(1.0, rel=0.01)
    assert score.worst_rotation_deg < 0.5
    assert score.worst_center_m < 0.05
    assert result.scale_sd == 0.0
    assert any("Only people connect 'cam_2' to 'cam_0', 'cam_1'" in note for note in result.notes)
    assert "The scale is that of the board." in result.notes


def test_what_the_board_tells_is_stated_for_each_camera(result):
    first, second, third = result.board_shares
    assert (first.n_images, second.n_images, third.n_images) == (10, 16, 0)
    assert second.reference == "cam_0"
    # Together, both know at least as much as the board alone.
    assert result.cameras[1].rotation_sd_deg <= 1.05 * second.rotation_sd_deg
    assert result.cameras[1].center_sd_m <= 1.05 * second.center_sd_m
    assert result.cameras[2].rotation_sd_deg > result.cameras[1].rotation_sd_deg


def test_people_alone_do_not_reach_this(result, folder):
    alone = posefuse.calibrate(people(large_rig()), intrinsics=folder / "lenses.toml")
    both = score_calibration(result.rig, large_rig())
    assert score_calibration(alone.rig, large_rig()).worst_rotation_deg > both.worst_rotation_deg


def test_a_camera_that_was_moved_in_between_is_named(folder, tmp_path):
    (tmp_path / "session").mkdir()
    (tmp_path / "session" / "board").symlink_to(folder / "session" / "board")
    rig = large_rig(turned_deg=8.0)
    native.write(people(rig), tmp_path / "session" / "keypoints.nc")
    with pytest.raises(CalibrationError, match="agree on the relative pose of no two cameras"):
        posefuse.calibrate(tmp_path / "session", SPEC, intrinsics=folder / "lenses.toml")


def test_the_scale_cannot_be_given_twice(folder):
    with pytest.raises(OptionsError, match="scale is that of the board"):
        posefuse.calibrate(
            folder / "session", SPEC, intrinsics=folder / "lenses.toml", people=PeopleOptions(stature_m=1.8)
        )


def test_the_command_prints_both_shares(folder, tmp_path, capsys):
    output = tmp_path / "calibration.toml"
    lenses = str(folder / "lenses.toml")
    main(["calibrate", str(folder / "session"), "--board", SPEC, "--intrinsics", lenses, "-o", str(output)])
    text = " ".join(capsys.readouterr().out.split())
    assert "3 cameras, 1 person" in text
    assert f"The board {SPEC}" in text
    assert "Only people connect 'cam_2'" in text
    assert posefuse.read_cameras(output).covariance() is not None
    assert "one person and the board" in output.with_suffix(".html").read_text("utf-8")


def test_board_alone_is_used_where_the_people_do_not_relate_the_cameras(folder, tmp_path):
    """Two cameras whose people could be explained by a rotation alone, and a board that both see."""
    place = session_of_two(folder, tmp_path, people(large_rig()).frames(0, 6))
    found = posefuse.calibrate(place, SPEC, intrinsics=folder / "lenses.toml")
    assert isinstance(found, posefuse.BoardCalibration)
    assert "By the board alone" in found.notes[0]
    assert found.notes[0] in found.rig.notes
    assert score_calibration(found.rig, large_rig()).worst_rotation_deg < 0.5


def test_reconstruct_calibrates_as_calibrate_does(folder, tmp_path):
    """A folder with a board and people has one calibration, whichever command makes it."""
    place = session_of_two(folder, tmp_path, people(large_rig()))
    main(["calibrate", str(place), "--board", SPEC, "--output", str(tmp_path / "calibration.toml")])
    words = ["--board", SPEC, "--solve", "frame", "--pairs", "labels", "--accept-findings"]
    main(["reconstruct", str(place), "--output", str(tmp_path / "out"), *words])
    written = (place / "calibration.toml").read_bytes()
    assert written == (tmp_path / "calibration.toml").read_bytes()
    assert b"people" in written
    assert (place / "calibration.html").read_bytes() == (tmp_path / "calibration.html").read_bytes()


def session_of_two(folder, tmp_path, detections):
    """A folder with the videos of the board, and keypoints of two cameras."""
    place = tmp_path / "session"
    place.mkdir()
    (place / "board").symlink_to(folder / "session" / "board")
    native.write(detections.views(("cam_0", "cam_1")), place / "keypoints.nc")
    return place
