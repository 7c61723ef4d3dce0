"""Lenses by a board that each camera sees alone."""

import pytest

import posefuse
from posefuse import RunOptions
from posefuse.errors import CalibrationError
from posefuse.io.calibration.read import read_cameras
from posefuse.pipeline.run.lens_stage import calibrate_lenses, lens_inputs
from posefuse.progress import Silent
from tests.boards import SPEC, render, small_rig
from tests.videos import coded_video


@pytest.fixture
def session(tmp_path):
    """Videos of people, and one video per camera of a board that it sees alone, in a folder of its own."""
    rig = small_rig()
    render(rig, tmp_path / "rendered")
    for name in rig.names:
        folder = tmp_path / "take" / "calibration" / "intrinsics" / f"int_{name}_img"
        folder.mkdir(parents=True)
        (tmp_path / "rendered" / f"{name}.mp4").rename(folder / "board.mp4")
        coded_video(tmp_path / "take" / f"{name}.mp4", 3)
    return tmp_path / "take"


def plan_of(folder, choices):
    return posefuse.plan_run(folder, choices, detector=lambda image: None, skeleton="coco_17")


def test_lenses_are_estimated_camera_by_camera(session, tmp_path):
    plan = plan_of(session, RunOptions(board=SPEC))
    stage = next(stage for stage in plan.stages if stage.name == "calibrate")
    assert stage.text == f"by the people, with the lenses by the board {SPEC} in calibration/intrinsics"
    assert plan.choices.lens_images == "calibration/intrinsics"
    found = calibrate_lenses(plan, tmp_path / "lenses.toml", Silent())
    assert not found.left_out
    rig = read_cameras(tmp_path / "lenses.toml")
    for camera in small_rig().cameras:
        assert rig[camera.name].matrix[0, 0] == pytest.approx(camera.matrix[0, 0], rel=0.02)
    again = plan_of(session, plan.choices)
    assert lens_inputs(again) == lens_inputs(plan)
    assert lens_inputs(plan_of(session, RunOptions(board=f"{SPEC},marker=0.7"))) != lens_inputs(plan)


def test_lenses_give_no_poses(session):
    problems = plan_of(session, RunOptions(board=SPEC, calibration="board")).problems
    assert "gives lenses but no poses" in problems[0]
    known = plan_of(session, RunOptions(board=SPEC, calibration="people", intrinsics="lenses.toml"))
    assert known.lens_views == ()


def test_images_without_the_board(session, tmp_path):
    for file in session.glob("calibration/intrinsics/*/board.mp4"):
        coded_video(file, 3)
    plan = plan_of(session, RunOptions(board=SPEC))
    with pytest.raises(CalibrationError, match="No image shows the board"):
        calibrate_lenses(plan, tmp_path / "lenses.toml", Silent())
    assert not (tmp_path / "lenses.toml").exists()
