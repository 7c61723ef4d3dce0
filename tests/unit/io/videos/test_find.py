"""Videos of a recording are found by the names of its views."""

from posefuse.io.videos.find import find_videos, videos_of_views


def touch(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def test_videos_of_the_first_folder_that_has_any(tmp_path):
    touch(tmp_path, "keypoints/a.json", "videos/cam1.mp4", "videos/cam2.MOV", "videos/cam1_overlay.mp4",
          "calibration/board.mp4", "videos/old/cam1.mp4")  # fmt: skip
    assert [path.name for path in find_videos(tmp_path)] == ["cam1.mp4", "cam2.MOV"]
    assert find_videos(tmp_path / "keypoints") == ()
    assert find_videos(tmp_path / "none") == ()


def test_views_are_matched_by_name_and_ambiguous_ones_left_out(tmp_path):
    touch(tmp_path, "trial1-cam1.mp4", "cam2.mp4", "cam2.avi", "other.mp4")
    assert {name: path.name for name, path in videos_of_views(tmp_path, ("cam1", "cam2", "cam3")).items()} == {
        "cam1": "trial1-cam1.mp4"
    }
