"""Boards in real images are recognized, and rooms with people and tiled floors show none."""

import pytest

from posefuse.io.board_images import find_images
from posefuse.io.board_look import look_for_board


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("POSEFUSE_CACHE", str(tmp_path / "cache"))


def test_videos_of_a_charuco_board(shared_data):
    found = look_for_board(find_images(shared_data("caliscope_charuco") / "calibration" / "extrinsic"))
    assert found is not None
    assert found.board.spec("54mm") == "charuco:4x5,square=54mm,marker=0.75,dict=4X4_50,inverted"
    assert len(found.views) == 4
    assert found.is_of_board


@pytest.mark.long
def test_pictures_of_a_checkerboard(shared_data):
    found = look_for_board(find_images(shared_data("pose2sim_videos") / "calibration" / "intrinsics"))
    assert found is not None
    assert found.board.spec("60mm") == "checkerboard:7x4,square=60mm"


@pytest.mark.long
def test_videos_of_a_person(shared_data):
    assert look_for_board(find_images(shared_data("pose2sim_videos") / "videos")) is None
