"""MediaPipe on four videos of a person who balances: people, times, and the same bytes from one and two detectors."""

import numpy as np
import pytest

from posefuse.io.keypoints.read import read_detections
from posefuse.model.options.detection import DetectOptions
from posefuse.pipeline.detect import detect_videos
from posefuse.pipeline.detection import chunks
from tests.installed import installed_home


def test_a_person_is_found_in_every_image(shared_data, tmp_path, monkeypatch):
    """Chunks of five examined images, so that the detectors share the videos."""
    monkeypatch.setenv("POSEFUSE_HOME", str(installed_home("mediapipe")))
    monkeypatch.setattr(chunks, "CHUNK_IMAGES", 5)
    videos = shared_data("pose2sim_videos")
    options = DetectOptions(detector="mediapipe", every=3, end_s=0.5)
    for jobs in (1, 2):
        outcome = detect_videos(videos, tmp_path / str(jobs), DetectOptions(**{**vars(options), "jobs": jobs}))
        assert [(view.name, view.n_images, view.n_with_people) for view in outcome.views] == [
            (f"cam0{c}", 10, 10) for c in (1, 2, 3, 4)
        ]
    for name in ("keypoints.parquet", "detection.json"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()
    found = read_detections(tmp_path / "1")
    np.testing.assert_allclose(found.time_s, np.repeat(np.arange(0, 30, 3)[:, None] / 60.0, 4, axis=1), atol=1e-4)
    assert found.rate_hz == pytest.approx(20.0, rel=1e-3)
    assert (np.asarray(found.confidence) > 0.3).mean() > 0.8
