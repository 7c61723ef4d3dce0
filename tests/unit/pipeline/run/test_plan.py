"""Plans of runs: what a folder contains decides what is done, and one message names what is missing."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse import RunOptions
from posefuse.errors import FileError, OptionsError, RecordingError
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.model.cameras import CameraRig
from posefuse.model.options.detection import DetectOptions
from posefuse.model.options.options import Options
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.coded_videos import SIZE_PX, small_rig
from tests.videos import coded_video


def stages_of(plan):
    return {stage.name: stage.text for stage in plan.stages}


def plan_of(folder, choices=None, options=None, **given):
    return posefuse.plan_run(
        folder, choices, options, **({"detector": lambda image: None, "skeleton": "coco_17"} | given)
    )


@pytest.fixture
def videos(tmp_path):
    (tmp_path / "videos").mkdir()
    for name in ("cam_0", "cam_1"):
        coded_video(tmp_path / "videos" / f"{name}.mp4", 3, size_px=SIZE_PX)
    return tmp_path


@pytest.fixture(scope="module")
def scene():
    return simulate(SceneOptions(duration_s=0.2, cameras=2, detector=CLEAN))


def test_videos_alone_are_calibrated_by_people(videos):
    plan = plan_of(videos)
    assert not plan.problems
    assert stages_of(plan) == {
        "detect": "the given function",
        "calibrate": "by the people",
        "synchronize": "by sound, start tags, keypoints",
        "reconstruct": "all people",
        "report": "with the videos",
    }
    assert plan.choices.files_of_views == {"cam_0": "videos/cam_0.mp4", "cam_1": "videos/cam_1.mp4"}
    assert [view.size_px for view in plan.views] == [SIZE_PX, SIZE_PX]


def test_a_calibration_and_keypoints_in_the_folder_are_used(videos, scene):
    anipose.write(small_rig(2), videos / "calibration.toml")
    plan = plan_of(videos)
    assert stages_of(plan)["calibrate"] == "nothing to do: 2 cameras in calibration.toml"
    native.write(scene.detections, videos / "keypoints.nc")
    plan = plan_of(videos, detector=None, skeleton=None)
    assert stages_of(plan)["detect"] == "nothing to do: 2D keypoints in keypoints.nc"
    assert "videos are not examined" in plan.notes[0]
    assert plan_of(videos, RunOptions(calibration="people")).choices.calibration == "people"


def test_lenses_that_do_not_exist_are_a_problem_of_the_plan(videos):
    (problem,) = plan_of(videos, RunOptions(intrinsics="lenses.toml")).problems
    assert "lenses.toml" in problem


def test_a_described_board_is_used_before_people(videos):
    (videos / "calibration").mkdir()
    for name in ("cam_0", "cam_1"):
        shutil.copy(videos / "videos" / f"{name}.mp4", videos / "calibration" / f"{name}.mp4")
    plan = plan_of(videos)
    assert stages_of(plan)["calibrate"] == "by the people"
    assert "calibration may show a board" in plan.notes[0]
    plan = plan_of(videos, RunOptions(board="charuco:7x5,square=30mm"))
    assert stages_of(plan)["calibrate"] == "by the board charuco:7x5,square=30mm in calibration"
    assert "nothing describes it" in plan_of(videos, RunOptions(calibration="board")).problems[0]
    assert "describes no board" in plan_of(videos, RunOptions(board="chess:7x5")).problems[0]


def test_board_videos_beside_videos_of_people(tmp_path):
    for name in ("cam_0", "cam_1", "cam_0_calib", "calibration-cam_1"):
        coded_video(tmp_path / f"{name}.mp4", 3)
    plan = plan_of(tmp_path)
    assert [view.name for view in plan.session.board_views] == ["cam_0", "cam_1"]
    assert [view.name for view in plan.views] == ["cam_0", "cam_1"]


def test_one_folder_per_camera(tmp_path):
    for name in ("left", "right"):
        (tmp_path / name).mkdir()
        coded_video(tmp_path / name / "take_1.mp4", 3)
    assert [view.name for view in plan_of(tmp_path).views] == ["left", "right"]


def test_several_recordings_are_listed(tmp_path):
    for trial in ("walk", "jump"):
        (tmp_path / trial).mkdir()
        for name in ("a", "b"):
            coded_video(tmp_path / trial / f"{name}.mp4", 3)
    with pytest.raises(RecordingError, match=r"has 2 recordings(.|\n)*jump"):
        plan_of(tmp_path)


def test_a_detector_that_is_not_installed(videos, monkeypatch, tmp_path):
    monkeypatch.setenv("POSEFUSE_HOME", str(tmp_path / "nothing"))
    plan = plan_of(videos, detector=None, skeleton=None)
    assert "Run: posefuse detector install mediapipe" in plan.problems[0]
    named = RunOptions(detect=DetectOptions(detector="mediapipe"))
    assert "posefuse detector install mediapipe" in plan_of(videos, named, detector=None, skeleton=None).problems[0]
    with pytest.raises(RecordingError, match="posefuse detector install"):
        posefuse.run(videos, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_extra_that_is_not_installed(videos, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    assert "pip install 'posefuse[video]'" in plan_of(videos).problems[0]


def test_broken_and_rotated_videos(videos):
    anipose.write(small_rig(2), videos / "calibration.toml")
    coded_video(videos / "videos" / "cam_0.mp4", 3, size_px=SIZE_PX[::-1])
    (videos / "videos" / "cam_1.mp4").write_bytes(b"no video")
    broken, rotated = plan_of(videos).problems
    assert "cam_1.mp4 cannot be read as a video" in broken
    assert "rotated by a quarter turn" in rotated
    coded_video(videos / "videos" / "cam_1.mp4", 3, size_px=(160, 90))
    assert "Use a calibration of this resolution" in plan_of(videos).problems[1]
    assert not plan_of(videos, RunOptions(calibration="people")).problems


def test_a_calibration_of_other_cameras_is_a_problem_before_the_detection(videos):
    rig = small_rig(2)
    named = [replace(camera, name=name) for camera, name in zip(rig.cameras, ("left", "right"), strict=True)]
    anipose.write(CameraRig(tuple(named)), videos / "calibration.toml")
    (problem,) = plan_of(videos).problems
    assert problem.startswith("View 'cam_0' matches no camera by name.")
    assert plan_of(videos, options=Options(camera_order=("left", "right"))).problems == ()


def test_folders_with_nothing_to_do(tmp_path):
    with pytest.raises(FileError, match="No recording at"):
        plan_of(tmp_path / "missing")
    assert "has neither videos nor 2D keypoints" in plan_of(tmp_path).problems[0]
    (tmp_path / "board").mkdir()
    for name in ("a", "b"):
        coded_video(tmp_path / "board" / f"{name}.mp4", 3)
    assert "images of a board (board), but neither" in plan_of(tmp_path).problems[0]


def test_files_that_options_name_must_exist(videos):
    for choices in (RunOptions(keypoints="no.nc"), RunOptions(timestamps="no.csv"), RunOptions(synchronize="no.toml"),
                    RunOptions(videos=("a=no.mp4",))):  # fmt: skip
        with pytest.raises(FileError, match="at no"):
            plan_of(videos, choices)
    assert "at no.toml" in plan_of(videos, RunOptions(calibration="no.toml")).problems[0]
    with pytest.raises(OptionsError, match="view=file"):
        RunOptions(videos=("a.mp4",))


def test_the_output_of_a_run_is_no_input(videos, scene):
    (videos / "out").mkdir()
    (videos / "out" / "run.json").write_text("{}")
    anipose.write(small_rig(2), videos / "out" / "calibration.toml")
    native.write(scene.detections, videos / "out" / "keypoints.nc")
    shutil.copy(videos / "videos" / "cam_0.mp4", videos / "out" / "overlay.mp4")
    plan = plan_of(videos)
    assert plan.choices.calibration == "people"
    assert plan.choices.keypoints is None


def test_another_file_than_the_project_file_states_is_named(videos, tmp_path):
    plan = plan_of(videos)
    stated = replace(plan.choices, inputs=replace(plan.choices.inputs, sha256=("videos/cam_0.mp4=abc",)))
    assert "videos/cam_0.mp4" in plan_of(videos, stated).notes[-1]
    assert np.isfinite([view.duration_s for view in plan.views]).all()


def test_lenses_beside_a_calibration_are_named(videos, scene, tmp_path_factory):
    anipose.write(scene.rig, videos / "calibration.toml")
    lenses = tmp_path_factory.mktemp("lenses") / "known.toml"
    anipose.write(scene.rig, lenses)
    plan = plan_of(videos, RunOptions(intrinsics=str(lenses)))
    assert any("known.toml are not used" in note and "calibration.toml" in note for note in plan.notes)
    assert not any("not used" in note for note in plan_of(videos).notes)
