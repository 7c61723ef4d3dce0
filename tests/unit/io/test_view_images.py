"""The views of a recording, and their images."""

import numpy as np
import pytest

from posefuse.errors import FileError, RecordingError
from posefuse.io.videos.library import import_pyav
from posefuse.io.view_images import find_views, open_source
from tests.filmed_blobs import bars_image, film


def picture(path, number=0, size_px=(96, 64)):
    av = import_pyav()
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w", format="image2") as container:
        stream = container.add_stream("png", rate=1)
        stream.width, stream.height, stream.pix_fmt = *size_px, "rgb24"
        container.mux(stream.encode(av.VideoFrame.from_ndarray(bars_image(number, 1, size_px), format="rgb24")))
        container.mux(stream.encode(None))
    return path


def names(views):
    return [view.name for view in views]


def test_videos_of_a_folder_are_views_in_natural_order(tmp_path):
    for name in ("cam_10", "cam_2", "cam_1"):
        film(tmp_path / f"{name}.mp4", 3)
    assert names(find_views(tmp_path)) == ["cam_1", "cam_2", "cam_10"]
    assert names(find_views([tmp_path / "cam_10.mp4", tmp_path / "cam_2.mp4"])) == ["cam_10", "cam_2"]
    assert names(find_views({"left": tmp_path / "cam_2.mp4"})) == ["left"]


def test_folders_of_one_video_each_name_the_views(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        film(tmp_path / name / "video.mp4", 3)
    assert names(find_views(tmp_path)) == ["a", "b"]
    assert names(find_views([tmp_path / "a" / "video.mp4", tmp_path / "b" / "video.mp4"])) == ["a", "b"]


def test_boards_and_outputs_are_left_out(tmp_path):
    for folder in ("videos", "calibration/intrinsics", "keypoints/overlay", "result"):
        (tmp_path / folder).mkdir(parents=True)
        film(tmp_path / folder / "cam1.mp4", 3)
    (tmp_path / "keypoints" / "detection.json").write_text("{}")
    (tmp_path / "result" / "reconstruction.nc").write_bytes(b"")
    (view,) = find_views(tmp_path)
    assert view.files == (tmp_path / "videos" / "cam1.mp4",)


def test_a_folder_of_pictures_is_a_view(tmp_path):
    for camera in ("left", "right"):
        for number in range(3):
            picture(tmp_path / camera / f"{number}.png", number)
    assert names(find_views(tmp_path)) == ["left", "right"]
    assert names(find_views(tmp_path / "left")) == ["left"]
    source = open_source(find_views(tmp_path)[0])
    assert (source.n_images, source.size_px, np.isnan(source.time_s).all()) == (3, (96, 64), True)
    found = list(source.open().images(1, 9, lambda number: number != 0))
    assert [number for number, _ in found] == [1, 2]
    assert all(np.array_equal(image, bars_image(number)) for number, image in found)


def test_pictures_of_different_sizes_are_one_sentence(tmp_path):
    picture(tmp_path / "left" / "0.png")
    picture(tmp_path / "left" / "1.png", size_px=(64, 48))
    source = open_source(find_views(tmp_path)[0])
    with pytest.raises(FileError, match=r"1\.png has 64 x 48 px, but the first picture of view 'left' has 96 x 64"):
        list(source.open().images(0, 2))


def test_a_broken_picture_is_one_sentence(tmp_path):
    picture(tmp_path / "left" / "0.png")
    (tmp_path / "left" / "1.png").write_bytes(b"no picture")
    source = open_source(find_views(tmp_path)[0])
    with pytest.raises(FileError, match=r"1\.png cannot be read as a picture"):
        list(source.open().images(0, 2))


def test_what_is_no_recording_is_one_sentence(tmp_path):
    with pytest.raises(FileError, match="No video or folder of videos at"):
        find_views(tmp_path / "absent")
    with pytest.raises(RecordingError, match="neither videos .* nor folders of pictures"):
        find_views(tmp_path)
    for folder in ("walk", "run"):
        (tmp_path / folder).mkdir()
        for camera in ("cam1", "cam2"):
            film(tmp_path / folder / f"{camera}.mp4", 3)
    with pytest.raises(RecordingError, match=r"has 2 sets of images. Give the folder of one:\n.*run  \(cam1, cam2\)"):
        find_views(tmp_path)
    with pytest.raises(RecordingError, match="Two views are called 'walk'"):
        find_views([tmp_path / "walk" / "cam1.mp4", tmp_path / "walk" / "cam1.mp4"])
    picture(tmp_path / "pictures" / "left" / "0.png")
    with pytest.raises(RecordingError, match="Some views are videos and others pictures: left have no times"):
        find_views([tmp_path / "walk", tmp_path / "pictures"])
