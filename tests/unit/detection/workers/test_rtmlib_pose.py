"""RTMPose's code in its real environment, on small models with the inputs and outputs of the real ones."""

import zipfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from posefuse.detection.open import open_detector
from posefuse.detection.registry import find_detector
from posefuse.detection.weights import missing_weights, weights_folder
from posefuse.errors import DetectorError
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.installed import installed_home
from tests.onnx_models import brightest_point, scaled_constants

WIDTH, HEIGHT = 320, 240
SCALE = 640 / WIDTH
POINTS = ((60.3, 80.0), (240.0, 150.6))
SCORES = np.array([[0.95], [0.9]])
BOXES = np.array([[20, 20, 100, 160], [200, 80, 280, 220]])


@pytest.fixture
def home(monkeypatch):
    monkeypatch.setenv("POSEFUSE_HOME", str(installed_home("rtmpose")))


def picture(points=POINTS):
    """Return a black image with a white blob at each point."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    blobs = [np.exp(-((x - px) ** 2 + (y - py) ** 2) / 18.0) for px, py in points]
    gray = 255.0 * np.clip(np.sum(blobs, axis=0), 0.0, 1.0) if blobs else np.zeros((HEIGHT, WIDTH))
    if blobs:
        gray[0, 0] = 255.0
    return np.repeat(gray[..., None], 3, axis=2).astype(np.uint8)


def people_model(folder):
    boxes = np.concatenate([BOXES * SCALE, SCORES], axis=1)
    return scaled_constants(folder / "people.onnx", {"dets": boxes[None]})


@pytest.mark.parametrize(("model", "keypoints"), [("body17", 17), ("body26", 26), ("wholebody133", 133)])
def test_several_people_are_found_in_their_boxes(home, tmp_path, model, keypoints):
    weights = (people_model(tmp_path), brightest_point(tmp_path / "pose.onnx", keypoints))
    detector = open_detector(f"rtmpose:{model}", weights=weights, device="cpu")
    assert len(detector.skeleton) == keypoints
    assert detector.several_people
    assert detector.version.count("weights") == 1
    found, nothing = detector.detect([picture(), picture(points=())])
    detector.close()
    assert len(nothing) == 0
    assert found.keypoints_px.shape == (2, keypoints, 2)
    assert found.boxes_px is not None
    np.testing.assert_allclose(found.boxes_px, BOXES, atol=1e-3)
    # A column of the model's input is 0.6 pixels of the image wide.
    np.testing.assert_allclose(found.keypoints_px[:, 0], POINTS, atol=0.7)
    assert (found.keypoints_px == found.keypoints_px[:, :1]).all()
    assert (found.confidence > 2.0).all()


def test_a_model_of_people_and_keypoints_at_once(home, tmp_path):
    boxes = np.concatenate([BOXES * SCALE, SCORES], axis=1)
    rows = np.concatenate([np.array(POINTS) * SCALE, np.full((2, 1), 0.8)], axis=1)
    points = np.repeat(rows[:, None], 17, axis=1)
    points[0, 3, 2] = 0.0
    weights = scaled_constants(tmp_path / "rtmo.onnx", {"dets": boxes[None], "keypoints": points[None]})
    detector = open_detector("rtmpose:body17", weights=(weights,))
    found, nothing = detector.detect([picture(), picture(points=())])
    detector.close()
    assert len(nothing) == 0
    np.testing.assert_allclose(found.keypoints_px[:, 0], POINTS, atol=1e-3)
    np.testing.assert_allclose(found.confidence[:, 0], 0.8, atol=1e-6)
    assert np.argwhere(np.isnan(found.keypoints_px[..., 0])).tolist() == [[0, 3]]


def test_weights_of_another_model_are_refused(home, tmp_path):
    pose = brightest_point(tmp_path / "pose.onnx", 17)
    with pytest.raises(DetectorError, match=r"pose\.onnx has 17 keypoints, and body26 has 26; use rtmpose:body17"):
        open_detector("rtmpose", weights=(people_model(tmp_path), pose))
    with pytest.raises(DetectorError, match="both weights of the same kind"):
        open_detector("rtmpose:body17", weights=(pose, pose))
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"no model")
    with pytest.raises(DetectorError, match=r"The detector rtmpose failed: .*broken\.onnx"):
        open_detector("rtmpose:body17", weights=(broken,))
    with pytest.raises(DetectorError, match="no CUDA"):
        open_detector("rtmpose", device="cuda")


def test_weights_that_cannot_be_downloaded_are_one_sentence(home, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("https_proxy", "http://127.0.0.1:9")
    with pytest.raises(
        DetectorError, match=r"rtmpose failed: its weights cannot be downloaded .*`weights`\.$"
    ) as raised:
        open_detector("rtmpose")
    # The files are those that decide on the default detector.
    text = str(raised.value)
    assert all(name in text for name in find_detector("rtmpose")[1].weights)
    assert str(weights_folder()) in text


@pytest.mark.parametrize("model", ["body26", "body17", "wholebody133"])
def test_archives_in_the_folder_of_weights_are_used(home, tmp_path, monkeypatch, model):
    """Two detectors that start at the same time unpack them once."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("https_proxy", "http://127.0.0.1:9")
    chosen = find_detector(f"rtmpose:{model}")[1]
    assert missing_weights(chosen) == chosen.weights
    models = people_model(tmp_path), brightest_point(tmp_path / "pose.onnx", len(shipped_skeleton(chosen.skeleton)))
    weights_folder().mkdir(parents=True)
    for name, file in zip(chosen.weights, models, strict=True):
        with zipfile.ZipFile(weights_folder() / name, "w") as archive:
            archive.write(file, "20230831/model/end2end.onnx")
    assert missing_weights(chosen) == ()
    with ThreadPoolExecutor(2) as threads:
        for opened in [threads.submit(open_detector, f"rtmpose:{model}", device="cpu") for _ in range(2)]:
            detector = opened.result()
            assert len(detector.detect([picture()])[0]) == 2
            detector.close()
    assert missing_weights(chosen) == ()
