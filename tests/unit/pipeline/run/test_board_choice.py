"""The board of a run: what images show, what settings describe, and what is missing."""

import pytest

import posefuse
from posefuse import RunOptions
from tests import boards
from tests.boards import render
from tests.videos import coded_video


@pytest.fixture
def videos(tmp_path):
    (tmp_path / "videos").mkdir()
    for name in ("cam_0", "cam_1"):
        coded_video(tmp_path / "videos" / f"{name}.mp4", 3)
    return tmp_path


def plan_of(folder, choices=None):
    return posefuse.plan_run(folder, choices, detector=lambda image: None, skeleton="coco_17")


def calibration_of(plan):
    return next(stage.text for stage in plan.stages if stage.name == "calibrate")


def test_a_board_is_recognized_by_what_the_images_show(videos):
    render(boards.small_rig(), videos / "tuesday")
    plan = plan_of(videos)
    assert [view.name for view in plan.views] == ["cam_0", "cam_1"]
    assert plan.choices.files_of_views["cam_0"] == "videos/cam_0.mp4"
    assert calibration_of(plan) == "by the people"
    (missing,) = plan.notes
    assert "tuesday shows a ChArUco board of 6 x 5 squares (4X4_50); the side of its squares is unknown" in missing
    described = f"{boards.SPEC},marker=0.75,dict=4X4_50"
    assert f"`board='{described.replace('80mm', '30mm')}'" in missing
    assert missing in plan_of(videos, RunOptions(calibration="board")).problems
    plan = plan_of(videos, RunOptions(board=described))
    assert calibration_of(plan) == f"by the board {described} in tuesday"
    assert plan_of(videos, plan.choices).board_views == plan.board_views
    # Settings of another board are not those of the images.
    (videos / "board.toml").write_text('[board]\nkind = "checkerboard"\ncolumns = 7\nrows = 5\nsquare_m = 0.03\n')
    plan = plan_of(videos)
    assert plan.choices.calibration == "people"
    assert "board.toml describes the board checkerboard:7x5,square=30mm. tuesday shows a ChArUco" in plan.notes[0]


def test_settings_of_a_board_that_no_image_shows(videos):
    settings = "[calibration.calculate.intrinsics]\nintrinsics_corners_nb = [4, 7]\nintrinsics_square_size = 60\n"
    (videos / "Config.toml").write_text(settings)
    plan = plan_of(videos)
    assert plan.choices.calibration == "people"
    assert "no sampled image of the videos shows a board" in plan.notes[0]


def test_videos_of_people_may_show_a_board(tmp_path):
    render(boards.small_rig(), tmp_path / "take")
    assert "The videos show a ChArUco board" in plan_of(tmp_path).notes[0]
    (tmp_path / "take" / "board.toml").write_text('[board]\nkind = "charuco"\ncolumns = 6\nrows = 5\nsquare_m = 0.08\n')
    plan = plan_of(tmp_path)
    assert calibration_of(plan) == "by the board take/board.toml in take"
    assert [view.name for view in plan.board_views] == ["cam_0", "cam_1"]
