"""FreeMoCap recordings."""

import numpy as np
import pytest

from posefuse import read_detections
from posefuse.errors import DetectionsError, FileError
from tests.layouts import (
    freemocap,
)


class TestFreeMoCap:
    def recording(self, folder, cameras: int = 2, videos: int = 2):
        raw = folder / "output_data" / "raw_data"
        raw.mkdir(parents=True)
        array = np.random.default_rng(0).uniform(0, 1000, (cameras, 4, 553, 3))
        np.save(raw / "mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy", array)
        (folder / "synchronized_videos").mkdir()
        for i in range(videos):
            (folder / "synchronized_videos" / f"{'aB'[i % 2]}_{i}.mp4").touch()
        return array

    def test_third_channel_is_depth_and_views_are_videos(self, tmp_path):
        array = self.recording(tmp_path)
        detections = read_detections(tmp_path)
        assert detections.skeleton.name == "mediapipe_holistic_553"
        assert detections.view_names == ("a_0", "B_1")
        np.testing.assert_array_equal(np.asarray(detections.depth)[0], array[0, 0, :, 2])
        assert np.isnan(detections.confidence).all()

    def test_without_videos_views_have_no_names(self, tmp_path):
        self.recording(tmp_path, videos=0)
        assert read_detections(tmp_path).view_names == ("camera_0", "camera_1")

    def test_number_of_videos_must_match(self, tmp_path):
        self.recording(tmp_path, cameras=3)
        with pytest.raises(FileError, match="2 videos, but .* has 3 cameras"):
            read_detections(tmp_path)


@pytest.mark.parametrize(
    ("tracker", "third", "field"),
    [("mediapipe_", 0.5, "depth"), ("openpose_", 0.5, "confidence"), ("yolo_", np.nan, None)],
)
def test_third_channel_depends_on_the_tracker(tracker, third, field, tmp_path):
    freemocap(tmp_path)
    (array,) = (tmp_path / "output_data" / "raw_data").glob("*2dData*")
    content = np.load(array)
    content[..., 2] = np.where(np.isnan(content[..., 0]), np.nan, third)
    array.unlink()
    np.save(array.with_name(array.name.replace("mediapipe_", tracker)), content)
    detections = read_detections(tmp_path, "body_25")
    for name in ("depth", "confidence"):
        values = getattr(detections, name)
        assert bool(values is not None and np.isfinite(values).any()) is (name == field)


def test_unknown_third_channel_is_an_error(tmp_path):
    freemocap(tmp_path)
    (array,) = (tmp_path / "output_data" / "raw_data").glob("*2dData*")
    array.rename(array.with_name("rtmpose_2dData_pixelXY.npy"))
    with pytest.raises(DetectionsError, match="--third-channel"):
        read_detections(tmp_path, "body_25")
