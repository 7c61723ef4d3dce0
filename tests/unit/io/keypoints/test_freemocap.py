"""FreeMoCap recordings."""

import shutil

import numpy as np
import pytest

from posefuse import Options, read_detections
from posefuse.errors import DetectionsError, FileError, RecordingError
from posefuse.io.open_recording import open_recording
from tests.layouts import VIEWS, freemocap, skellycam_times

N_FRAMES, RATE_HZ = 6, 25.0


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
    with pytest.raises(DetectionsError, match="`third_channel="):
        read_detections(tmp_path, "body_25")


def opened(folder, **options):
    return open_recording(folder, options=Options(skeleton="body_25", **options)).detections


def test_times_are_those_of_the_camera_library(tmp_path):
    freemocap(tmp_path)
    detections = opened(tmp_path)
    expected_s = np.arange(N_FRAMES)[:, None] / RATE_HZ + [0.0, 0.003]
    np.testing.assert_allclose(detections.time_s, expected_s, atol=1e-9)
    assert "timestamps: times read as nanoseconds." in detections.notes


def test_repeated_frames_repeat_their_time(tmp_path):
    """A slower camera repeats a frame, so two frames have one time."""
    freemocap(tmp_path)
    repeated_s = np.array([0, 1, 1, 3, 4, 5]) / RATE_HZ
    skellycam_times(tmp_path / "synchronized_videos" / "timestamps", VIEWS[1], repeated_s)
    detections = opened(tmp_path)
    assert detections.n_frames == N_FRAMES
    used = np.isfinite(detections.time_s[:, 1])
    assert set(np.round(detections.time_s[used, 1] * RATE_HZ, 6)) == {0, 1, 3, 4, 5}


def test_copied_timestamps_are_used_once(tmp_path):
    """The program copies the timestamps of imported videos; two sets that differ need a choice."""
    freemocap(tmp_path)
    shutil.copytree(tmp_path / "synchronized_videos" / "timestamps", tmp_path / "timestamps")
    assert opened(tmp_path).rate_hz == RATE_HZ
    skellycam_times(tmp_path / "timestamps", VIEWS[0], np.arange(N_FRAMES) / 50.0)
    with pytest.raises(RecordingError, match="2 sets of timestamps"):
        opened(tmp_path)


@pytest.mark.parametrize("mismatch", ["count", "names"])
def test_timestamps_that_do_not_match_are_reported(mismatch, tmp_path):
    """With equal numbers of frames and one rate, the recording is read at this rate."""
    freemocap(tmp_path)
    folder = tmp_path / "synchronized_videos" / "timestamps"
    for name in VIEWS:
        skellycam_times(folder, name, np.arange(9) / RATE_HZ)
    if mismatch == "names":
        for file in folder.glob(f"{VIEWS[0]}*"):
            file.rename(file.with_name(f"other_{file.name}"))
    detections = opened(tmp_path)
    assert detections.rate_hz == RATE_HZ
    np.testing.assert_allclose(detections.time_s[:, 1], np.arange(N_FRAMES) / RATE_HZ)
    why = "expected a time for each of 6 frames, got 9" if mismatch == "count" else f"no times for {VIEWS[0]}"
    (note,) = (note for note in detections.notes if "do not match and are not used" in note)
    assert why in note
    assert "the frame rate of timestamps, 25 Hz, is used" in note


def test_mismatched_timestamps_without_a_common_rate_are_an_error(tmp_path):
    freemocap(tmp_path)
    folder = tmp_path / "synchronized_videos" / "timestamps"
    skellycam_times(folder, VIEWS[0], np.arange(9) / RATE_HZ)
    skellycam_times(folder, VIEWS[1], np.arange(9) / 50.0)
    with pytest.raises(DetectionsError, match=r"expected a time for each of 6 frames, got 9.*`rate_hz`"):
        opened(tmp_path)
    assert opened(tmp_path, rate_hz=30.0).rate_hz == 30.0


def test_a_stated_rate_that_differs_from_the_timestamps_is_reported(tmp_path):
    freemocap(tmp_path)
    (tmp_path / "recording_parameters.json").write_text('{"framerate": 30.0}')
    detections = opened(tmp_path)
    assert detections.rate_hz == RATE_HZ
    assert any("timestamps are at 25 Hz, but recording_parameters.json states 30 Hz" in n for n in detections.notes)
