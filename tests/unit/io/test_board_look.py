"""A look for a board in videos and pictures."""

import shutil

import cv2
import pytest

from posefuse.io import board_look
from posefuse.io.board_images import find_images
from posefuse.io.board_look import look_for_board
from tests.boards import SPEC, picture, read_board_spec, render, small_rig
from tests.videos import coded_video


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("POSEFUSE_CACHE", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def videos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("board") / "videos"
    render(small_rig(), folder)
    return folder


def test_videos_of_a_board_are_examined_once(videos, tmp_path, monkeypatch):
    found = look_for_board(find_images(videos))
    assert found is not None
    assert found.is_of_board
    assert found.board.spec("80mm") == f"{SPEC},marker=0.75,dict=4X4_50"
    assert found.views == ("cam_0", "cam_1")
    # Other names of the same content are answered from the cache; other content is not.
    shutil.copytree(videos, tmp_path / "copy")
    monkeypatch.setattr(board_look, "identify_board", lambda grays: None)
    assert look_for_board(find_images(tmp_path / "copy")) == found
    with (tmp_path / "copy" / "cam_0.mp4").open("ab") as stream:
        stream.write(b"more")
    changed = look_for_board(find_images(tmp_path / "copy"))
    assert changed is not None
    assert changed.views == ("cam_1",)


def test_pictures_and_unreadable_images(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        cv2.imwrite(str(tmp_path / name / "1.png"), picture(read_board_spec("checkerboard:7x5,square=60mm"), 1000.0))
    (tmp_path / "b" / "1.png").write_bytes(b"no picture")
    found = look_for_board(find_images(tmp_path))
    assert found is not None
    assert found.views == ("a",)


def test_videos_without_a_board(tmp_path):
    for name in ("a", "b"):
        coded_video(tmp_path / f"{name}.mp4", 12)
    assert look_for_board(find_images(tmp_path)) is None
