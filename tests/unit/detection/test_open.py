"""A detector is opened by its name, its file, or as a callable."""

import sys
from pathlib import Path

import numpy as np
import pytest

from posefuse.detection import open as opening
from posefuse.detection.environments import Environment
from posefuse.detection.open import default_detector, open_detector, opens_several
from posefuse.detection.registry import find_detector
from posefuse.detection.weights import weights_folder
from posefuse.errors import DetectorError
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.workers import BRIGHTNESS, worker_file

IMAGES = [np.full((4, 6, 3), value, dtype=np.uint8) for value in (10, 20)]


def brightness(image):
    """Return one person whose keypoints are all at the brightness of the image."""
    return np.full((1, 17, 3), float(image.mean()))


def test_a_function_is_a_detector():
    with pytest.raises(DetectorError, match="needs `skeleton`"):
        open_detector(brightness)
    detector = open_detector(brightness, skeleton="coco_17")
    assert (detector.name, detector.skeleton) == ("brightness", shipped_skeleton("coco_17"))
    assert [found.keypoints_px[0, 0, 0] for found in detector.detect(IMAGES)] == [10.0, 20.0]
    assert [found.keypoints_px[0, 0, 0] for found in detector.detect(np.array(IMAGES))] == [10.0, 20.0]
    detector.reset()
    detector.close()
    assert open_detector(detector) is detector
    assert not opens_several(brightness)


def test_a_function_with_a_memory_is_reset():
    class Counter:
        skeleton = "coco_17"
        count = 0

        def __call__(self, image):
            self.count += 1
            return np.full((17, 3), self.count)

        def reset(self):
            self.count = 0

    detector = open_detector(Counter())
    assert [found.keypoints_px[0, 0, 0] for found in detector.detect(IMAGES)] == [1.0, 2.0]
    detector.reset()
    assert detector.detect(IMAGES)[0].keypoints_px[0, 0, 0] == 1.0


def test_the_exception_of_a_function_is_one_sentence():
    def fails(image):
        raise ValueError("no model")

    with pytest.raises(DetectorError, match=r"The detector fails failed: ValueError: no model\."):
        open_detector(fails, skeleton="coco_17").detect(IMAGES)


def test_an_unknown_name_is_an_error():
    with pytest.raises(DetectorError, match="no detector 'nothing'.*worker file"):
        open_detector("nothing")


def test_a_worker_file_is_a_detector(tmp_path):
    path = worker_file(tmp_path, BRIGHTNESS)
    for name in (path, str(path)):
        detector = open_detector(name)
        assert detector.name == "own"
        assert detector.version.startswith("test 1 worker file ")
        assert [found.keypoints_px[0, 0, 0] for found in detector.detect(IMAGES)] == [10.0, 20.0]
        detector.close()
    assert opens_several(path)
    with pytest.raises(DetectorError, match=r"no file .*other\.py\. In its folder: own\.py"):
        open_detector(tmp_path / "other.py")


def test_the_interpreter_may_be_the_folder_of_its_environment(tmp_path):
    path = worker_file(tmp_path, BRIGHTNESS)
    (tmp_path / "lab").symlink_to(sys.prefix, target_is_directory=True)
    open_detector(path, python=tmp_path / "lab").close()
    with pytest.raises(DetectorError, match="no Python interpreter .*empty"):
        open_detector(path, python=tmp_path / "empty")


def test_a_detector_that_is_not_installed_has_its_command(tmp_path, monkeypatch):
    monkeypatch.setenv("POSEFUSE_HOME", str(tmp_path))
    with pytest.raises(DetectorError, match=r"not installed\. Run: posefuse detector install mediapipe \(\d+ MB"):
        open_detector("mediapipe")
    with pytest.raises(DetectorError, match=r"No detector is installed\. Run: posefuse detector install mediapipe"):
        default_detector()
    with pytest.raises(DetectorError, match=r"takes `weights` is installed\. Run: posefuse detector install rtmpose\."):
        default_detector(weights_given=True)
    with pytest.raises(DetectorError, match=r"has no model 'hands'\. It has pose, people, holistic"):
        open_detector("mediapipe:hands")
    with pytest.raises(DetectorError, match=r"CPU only"):
        open_detector("mediapipe", device="cuda")
    with pytest.raises(DetectorError, match=r"no file weights\.onnx"):
        open_detector("mediapipe", weights=(Path("weights.onnx"),))


def test_the_default_detector_can_run_now(tmp_path, monkeypatch):
    """Weights on this computer or given ones decide, and the reason is stated."""
    installed = {"rtmpose", "mediapipe"}

    def environment(record):
        return Environment(tmp_path, "installed" if record.name in installed else "not installed", Path())

    monkeypatch.setattr(opening, "environment_of", environment)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    best = default_detector()
    assert best.name == "mediapipe"
    assert best.reason == (
        "because the weights of rtmpose are not on this computer; `detector='rtmpose'` downloads them"
    )
    assert default_detector(weights_given=True).name == "rtmpose"
    with pytest.raises(DetectorError, match="`detector_python` needs `detector`"):
        default_detector(python_given=True)
    installed.remove("mediapipe")
    assert default_detector() == opening.DefaultDetector(
        "rtmpose", "the only one installed; it downloads its weights now"
    )
    installed.add("mediapipe")
    weights_folder().mkdir(parents=True)
    for i, file in enumerate(find_detector("rtmpose")[1].weights):
        assert default_detector().name == "mediapipe"
        (weights_folder() / file).with_suffix(".onnx" if i else ".zip").touch()
    assert default_detector() == opening.DefaultDetector("rtmpose", "the best one installed")


def test_weights_for_a_detector_that_contains_them_are_refused(tmp_path):
    (tmp_path / "a.onnx").touch()
    with pytest.raises(DetectorError, match="mediapipe takes no `weights`"):
        open_detector("mediapipe", weights=(tmp_path / "a.onnx",))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import numpy", "own.py has no class Detector"),
        ("class Detector:\n    skeleton = 'coco_17'\n    def __init__(self, s): pass", "own.py has no detect"),
        ("class Detector:\n    detect = None\n    def __init__(self, s): pass", "own.py has no skeleton"),
        ("class Detector", r"SyntaxError: \S.* \(own.py, line 1\)\.$"),
        ("import mmpose", r"No module named 'mmpose' \(own.py, line 1\)\.$"),
    ],
)
def test_a_worker_file_that_does_not_fit_the_protocol_is_one_sentence(tmp_path, text, message):
    with pytest.raises(DetectorError, match=message):
        open_detector(worker_file(tmp_path, text))


def test_a_worker_file_may_take_folders_of_weights_and_must_return_numbers(tmp_path):
    text = """
class Detector:
    skeleton = ["a", "b"]
    def __init__(self, settings):
        self.version = settings["weights"][0]
    def detect(self, images):
        return [{"keypoints": 1} for _ in images]
"""
    (tmp_path / "model").mkdir()
    detector = open_detector(worker_file(tmp_path, text), weights=(tmp_path / "model",))
    assert detector.version.startswith(str(tmp_path / "model"))
    with pytest.raises(DetectorError, match=r"returned dict .* Expected x, y and confidence, shape \(person, keypoint"):
        detector.detect(IMAGES)
    detector.close()
