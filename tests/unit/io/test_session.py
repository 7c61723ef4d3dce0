"""Contents of a folder, by the names of folders and files."""

from pathlib import Path

import pytest

from posefuse.errors import FileError, RecordingError
from posefuse.io.session import find_session, locate, place_of, relative


def made(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    return folder


def names_of(folder: Path) -> tuple[list[str], list[str]]:
    session = find_session(folder)
    return [view.name for view in session.views], [view.name for view in session.board_views]


@pytest.mark.parametrize(
    ("files", "people", "board"),
    [
        (("a.mp4", "b.MOV", "calib/a.mp4", "calib/b.mp4"), ["a", "b"], ["a", "b"]),
        (("videos/a.mp4", "videos/b.mp4", "videos/charuco_a.mp4", "videos/charuco_b.mp4"), ["a", "b"], ["a", "b"]),
        (("synchronized_videos/a.mp4", "annotated_videos/a.mp4", "raw/a.mp4"), ["a"], []),
        (("left/x.mp4", "right/x.mp4"), ["left", "right"], []),
        (("pictures/a/1.jpg", "pictures/b/1.jpg"), ["a", "b"], []),
        (("calibration/intrinsics/a/1.jpg", "calibration/intrinsics/b/1.jpg", "calibration/extrinsics/a.png", "a.mp4"),
         ["a"], []),
    ],
)  # fmt: skip
def test_roles_by_name(tmp_path, files, people, board):
    assert names_of(made(tmp_path / "session", *files)) == (people, board)


def test_videos_that_are_all_named_after_a_board_are_those_of_the_recording(tmp_path):
    assert names_of(made(tmp_path, "board_a.mp4", "board_b.mp4")) == (["board_a", "board_b"], [])


def test_a_board_beside_the_trials_of_a_session(tmp_path):
    made(tmp_path, "calibration/a.mp4", "calibration/b.mp4", "walk/a.mp4", "walk/b.mp4", "config.toml")
    assert names_of(tmp_path / "walk") == (["a", "b"], ["a", "b"])
    assert find_session(tmp_path).settings == ("config.toml",)


@pytest.mark.parametrize("inside", ["1.jpg", "1.mp4"])
def test_images_for_lenses_are_named_after_the_videos(tmp_path, inside):
    made(tmp_path, "videos/cam01.mp4", "videos/cam02.mp4", "calibration/extrinsics/cam01_ext.png",
         *(f"calibration/intrinsics/int_cam0{k}_img/{inside}" for k in (1, 2)))  # fmt: skip
    session = find_session(tmp_path)
    assert [view.name for view in session.views] == ["cam01", "cam02"]
    assert [view.name for view in session.lens_views] == ["cam01", "cam02"]
    assert place_of(session.lens_views, tmp_path) == "calibration/intrinsics"
    assert session.board_views == ()


def test_what_images_show_decides_between_several_sets(tmp_path):
    made(tmp_path, "one/a.mp4", "one/b.mp4", "two/a.mp4", "two/b.mp4")
    with pytest.raises(RecordingError, match="2 recordings"):
        find_session(tmp_path)
    session = find_session(tmp_path, None, lambda views: views[0].files[0].parent.name == "one")
    assert place_of(session.views, tmp_path) == "two"
    assert place_of(session.board_views, tmp_path) == "one"


def test_settings_of_a_project_describe_the_board_of_its_sessions(tmp_path):
    made(tmp_path, "session/a.mp4", "session/b.mp4")
    settings = "[calibration]\nboard_type = 'checkerboard'\nboard_size = [7, 5]\nboard_square_side_length = 25\n"
    (tmp_path / "config.toml").write_text(settings)
    assert find_session(tmp_path / "session").board == tmp_path / "config.toml"


def test_paths(tmp_path):
    made(tmp_path, "videos/a.mp4")
    session = find_session(tmp_path)
    assert place_of(session.views, tmp_path) == "videos"
    assert relative(tmp_path / "videos" / "a.mp4", tmp_path) == "videos/a.mp4"
    assert locate("videos/a.mp4", tmp_path) == tmp_path / "videos" / "a.mp4"
    assert locate("videos/*.mp4", tmp_path) == tmp_path / "videos" / "*.mp4"
    with pytest.raises(FileError, match="No file at"):
        locate("videos/b.mp4", tmp_path)
    with pytest.raises(RecordingError, match="is a file"):
        find_session(tmp_path / "videos" / "a.mp4")
