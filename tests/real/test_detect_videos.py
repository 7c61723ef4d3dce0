"""MediaPipe on four videos of a person who balances: people, times, and the same bytes from one and two detectors."""

import numpy as np
import pytest

from posefuse.detection.workers.mediapipe_people import MOST_SHARED, shared_area
from posefuse.io.keypoints.read import read_detections
from posefuse.model.options.detection import DetectOptions
from posefuse.pipeline.detect import detect_videos
from posefuse.pipeline.detection import chunks
from posefuse.preprocess.link_detections import link_rows
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


@pytest.fixture(scope="module")
def people_alone(shared_data, tmp_path_factory):
    """Return the keypoints of the person in two videos, shape (view, image, keypoint, 2), and the number of tracks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("POSEFUSE_HOME", str(installed_home("mediapipe")))
        videos = [shared_data("pose2sim_videos") / "videos" / f"cam0{c}.mp4" for c in (1, 2)]
        outcome = detect_videos(videos, tmp_path_factory.mktemp("alone"), DetectOptions(detector="mediapipe"))
    found = read_detections(outcome.keypoints)
    assert found.n_frames == 100
    keypoints = np.asarray(found.keypoints_px).reshape(100, 2, -1, 2)
    return np.moveaxis(keypoints, 1, 0), [view.n_tracks for view in outcome.views], found.skeleton


def test_a_person_alone_is_one_track(people_alone):
    """In the second video, MediaPipe mistakes the limbs of three images."""
    assert people_alone[1] == [1, 1]


def test_tracks_of_two_people_who_cross_do_not_change_their_person(people_alone):
    """Two real people, composed: they cross 12 times, and the one behind is not detected while hidden."""
    (front, behind), _, skeleton = people_alone
    wrong = kept = in_front = 0
    for crossing in range(12):
        speed_px, height = 6.0 + 2.0 * crossing, 40.0 * (crossing % 3)
        pair = [front - front.mean((0, 1)), behind - behind.mean((0, 1)) + [0.0, height]]
        way = speed_px * (np.arange(100) - 50.0)[:, None, None] * [1.0, 0.0]
        pair = [pair[0] + way, pair[1] - way]
        hidden = np.array([shared_area(*each) > MOST_SHARED for each in zip(*pair, strict=True)])
        counts = np.where(hidden, 1, 2)
        owners = np.concatenate([[0] if gone else [0, 1] for gone in hidden])
        rows = np.concatenate([each[None, i] for i in range(100) for each in pair[: counts[i]]])
        starts = np.concatenate([[0], np.cumsum(counts)])
        track = link_rows(starts, np.arange(100) / 60.0, rows, np.full(len(rows), -1), skeleton)
        for t in range(track.max() + 1):
            people = np.bincount(owners[track == t], minlength=2)
            wrong += people.min()
            kept += people.max() if people.sum() > 20 else 0
        in_front += len(np.unique(track[owners == 0])) == 1
        assert hidden.any()
    assert wrong == 0
    assert in_front >= 10
    assert kept > 2000
