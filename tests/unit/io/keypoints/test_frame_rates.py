"""Frame rates come from settings and videos beside keypoints, and a note names the source."""

import json

import numpy as np
import pytest

from posefuse.io.keypoints.frame_rates import FrameRate, find_frame_rate
from posefuse.io.keypoints.read import read_keypoints
from posefuse.io.keypoints.request import Request
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.files import write_openpose
from tests.videos import coded_video

CONFIG = "[project]\nframe_rate = 60\n"
SESSION = "subjectID: a\nframerate: 120\nheight_m: 1.8\n"
PARAMETERS = json.dumps({"post_processing_parameters_model": {"framerate": 24.0}})


@pytest.fixture
def folder(tmp_path):
    """Return a folder of OpenPose files, which state no frame rate."""
    scene = simulate(SceneOptions(duration_s=0.2, cameras=2, detector=CLEAN))
    write_openpose(tmp_path / "trial" / "pose", scene.detections)
    return tmp_path / "trial"


@pytest.mark.parametrize(
    ("name", "text", "rate_hz"),
    [
        ("Config.toml", CONFIG, 60.0),
        ("sessionMetadata.yaml", SESSION, 120.0),
        ("recording_parameters.json", PARAMETERS, 24.0),
    ],
)
def test_rate_is_read_from_settings_beside_the_keypoints(folder, name, text, rate_hz):
    (folder / name).write_text(text)
    detections = read_keypoints(folder / "pose", Request())
    assert detections.rate_hz == rate_hz
    assert np.nanmax(detections.time_s) == pytest.approx((detections.n_frames - 1) / rate_hz)
    assert f"Frame rate {rate_hz:g} Hz read from {name}." in detections.notes


def test_requested_rate_takes_precedence(folder):
    (folder / "sessionMetadata.yaml").write_text(SESSION)
    detections = read_keypoints(folder / "pose", Request(rate_hz=30.0))
    assert detections.rate_hz == 30.0
    assert not any("read from" in note for note in detections.notes)


def test_rate_is_read_from_videos_beside_the_keypoints(folder):
    (folder / "videos").mkdir()
    for name in ("cam_0.mp4", "cam_1.mp4"):
        coded_video(folder / "videos" / name, 3, 25.0)
    assert find_frame_rate(folder / "pose") == FrameRate(25.0, "cam_0.mp4")
    coded_video(folder / "videos" / "cam_1.mp4", 3, 50.0)
    assert find_frame_rate(folder / "pose") is None


@pytest.mark.parametrize("text", ["framerate: default\n", "framerate: 0\n", "a: [\n", "framerate: -3\n"])
def test_settings_without_a_valid_rate(folder, text):
    (folder / "sessionMetadata.yaml").write_text(text)
    (folder / "recording_parameters.json").write_text("[1, ")
    assert find_frame_rate(folder / "pose") is None
    assert read_keypoints(folder / "pose", Request()).rate_hz is None
