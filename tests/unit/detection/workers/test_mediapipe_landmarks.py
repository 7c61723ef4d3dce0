"""MediaPipe in its real environment: a person in a video, an empty image, and the same again after a reset."""

import numpy as np
import pytest

from posefuse.detection.open import open_detector
from posefuse.io.videos.reader import open_video
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.installed import installed_home


@pytest.fixture
def home(monkeypatch):
    monkeypatch.setenv("POSEFUSE_HOME", str(installed_home("mediapipe")))


def filmed(folder, count=4):
    """Return the first images of a person of about 1,300 px height."""
    images = open_video(folder / "videos" / "cam01.mp4").images()
    return [image.rgb for image, _ in zip(images, range(count), strict=False)]


def test_an_image_without_people_is_empty(home):
    detector = open_detector("mediapipe", device="cpu")
    assert detector.version == "mediapipe 0.10.21, pose, model complexity 1, not smoothed"
    assert not detector.several_people
    assert [len(each) for each in detector.detect(np.zeros((2, 120, 90, 3), dtype=np.uint8))] == [0, 0]
    detector.close()


def test_a_person_is_found_at_the_same_place_after_a_reset(home, shared_data):
    images = filmed(shared_data("pose2sim_videos"))
    detector = open_detector("mediapipe")
    first = detector.detect(images)
    detector.reset()
    second = [detector.detect([image])[0] for image in images]
    detector.close()
    skeleton = shipped_skeleton("mediapipe_33")
    assert detector.skeleton == skeleton
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.keypoints_px, other.keypoints_px)
        assert one.keypoints_px.shape == (1, 33, 2)
        height_px = {name: one.keypoints_px[0, skeleton.index(name), 1] for name in ("nose", "left_hip", "left_heel")}
        assert height_px["nose"] + 200 < height_px["left_hip"] < height_px["left_heel"] - 200
        assert (one.confidence > 0.3).mean() > 0.7


def test_holistic_adds_hands_and_face(home, shared_data):
    detector = open_detector("mediapipe:holistic")
    found = detector.detect(filmed(shared_data("pose2sim_videos"), 2))[1]
    detector.close()
    seen = np.isfinite(found.keypoints_px[0, :, 0])
    assert detector.skeleton.name == "mediapipe_holistic_543"
    assert seen[:33].all()
    assert seen[33:].any()
    # A part of the body is seen as a whole or not at all.
    assert {*np.add.reduceat(seen, [33, 501, 522]).tolist()} <= {0, 21, 468}
