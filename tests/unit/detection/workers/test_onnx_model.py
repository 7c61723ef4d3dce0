"""ONNX models that a TOML file describes, in their real environment."""

import numpy as np
import pytest

from posefuse.detection.open import open_detector
from posefuse.errors import DetectorError
from tests.installed import installed_home
from tests.onnx_models import brightest_point, node, save_model, scaled_constants

WIDTH, HEIGHT = 320, 240
POINT = (200.3, 100.8)


@pytest.fixture(autouse=True)
def _home(monkeypatch):
    monkeypatch.setenv("POSEFUSE_HOME", str(installed_home("onnx")))


def picture(point=POINT):
    """Return a black image with a white blob."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    gray = 255.0 * np.exp(-((x - point[0]) ** 2 + (y - point[1]) ** 2) / 50.0)
    return np.repeat(gray[..., None], 3, axis=2).astype(np.uint8)


def detect(folder, text, images=None):
    path = folder / "mine.toml"
    path.write_text(text)
    detector = open_detector(path)
    found = detector.detect([picture()] if images is None else images)
    name = (detector.name, detector.several_people, len(detector.skeleton))
    detector.close()
    return found, name


@pytest.mark.parametrize("resize", ["letterbox", "corner", "stretch"])
def test_columns_and_rows_of_a_model_return_to_the_image(tmp_path, resize):
    brightest_point(tmp_path / "pose.onnx", 17)
    text = f"model = 'pose.onnx'\nskeleton = 'coco_17'\n[input]\nresize = '{resize}'\n[output]\nkind = 'simcc'\n"
    found, name = detect(tmp_path, text)
    assert name == ("mine", False, 17)
    # A column of the model is 1.7 px wide, a row of the stretched image 0.9.
    np.testing.assert_allclose(found[0].keypoints_px[0, 16], POINT, atol=1.2)


def test_heatmaps_of_a_batch(tmp_path):
    """The model returns the red channel, reduced four times by averaging, as the map of one keypoint."""
    nodes = [
        node("Slice", ["input", "zero", "one", "axis"], "red"),
        node("AveragePool", ["red"], "heat", kernel_shape=[4, 4], strides=[4, 4]),
    ]
    constants = {"zero": np.array([0]), "one": np.array([1]), "axis": np.array([1])}
    shape, out = ("batch", 3, 256, 256), ("batch", 1, 64, 64)
    save_model(tmp_path / "heat.onnx", nodes, {"input": shape}, {"heat": out}, constants)
    text = (
        "model = 'heat.onnx'\nskeleton = ['tail']\n[input]\npad = 0\nstd = [255, 255, 255]\n"
        "[output]\nkind = 'heatmaps'\n"
    )
    points = [(20 + 13.7 * i, 30 + 9.1 * i) for i in range(20)]
    found, _ = detect(tmp_path, text, [picture(point) for point in points])
    np.testing.assert_allclose([each.keypoints_px[0, 0] for each in found], points, atol=0.4)
    assert all(0.5 < each.confidence[0, 0] <= 1.0 for each in found)


def test_people_in_columns_with_a_score(tmp_path):
    """As MoveNet: y, x and confidence as fractions, then a box and the person's score."""
    rows = np.zeros((1, 3, 11))
    rows[0, :, :6] = [0.25, 0.5, 0.9, 0.75, 0.5, 0.8]
    rows[0, :, 10] = [0.9, 0.2, 0.6]
    scaled_constants(tmp_path / "move.onnx", {"people": rows}, (256, 256))
    text = (
        "model = 'move.onnx'\nskeleton = ['head', 'tail']\nseveral_people = true\n[input]\nresize = 'stretch'\n"
        "[output]\norder = 'yxc'\nnormalized = true\nscore_column = 10\n"
    )
    found, name = detect(tmp_path, text, [np.full((HEIGHT, WIDTH, 3), 255, dtype=np.uint8)])
    assert name == ("mine", True, 2)
    assert found[0].keypoints_px.shape == (2, 2, 2)
    np.testing.assert_allclose(found[0].keypoints_px[0], [[159.5, 59.5], [159.5, 179.5]], atol=1e-3)
    np.testing.assert_allclose(found[0].confidence[1], [0.9, 0.8], atol=1e-6)


def test_overlapping_candidates_are_one_person(tmp_path):
    """As YOLO: box, score and keypoints in rows, one column per candidate."""
    candidates = np.zeros((1, 11, 40))
    candidates[0, :, 0] = [100, 200, 80, 160, 0.7, 100, 150, 0.9, 110, 250, 0.8]
    candidates[0, :, 1] = [102, 201, 80, 160, 0.8, 101, 151, 0.9, 111, 251, 0.8]
    candidates[0, :, 2] = [300, 200, 80, 160, 0.6, 300, 150, 0.9, 310, 250, 0.1]
    candidates[0, :, 3] = [500, 200, 80, 160, 0.1, 500, 150, 0.9, 510, 250, 0.1]
    scaled_constants(tmp_path / "yolo.onnx", {"out": candidates})
    text = (
        "model = 'yolo.onnx'\nskeleton = ['a', 'b']\nseveral_people = true\n[input]\npad = 0\n[output]\nkind = 'yolo'\n"
    )
    found, _ = detect(tmp_path, text, [np.full((HEIGHT, WIDTH, 3), 255, dtype=np.uint8)])
    # 320 x 240 in 640 x 640: twice as large, 80 rows below the top.
    expected = np.array([[[101, 151], [111, 251]], [[300, 150], [310, 250]]])
    np.testing.assert_allclose(found[0].keypoints_px, (expected - [0, 80]) / 2 - 0.5, atol=1e-3)
    assert len(detect(tmp_path, text, [np.zeros((240, 320, 3), np.uint8)])[0][0]) == 0


def test_a_model_that_the_description_does_not_fit_is_one_sentence(tmp_path):
    scaled_constants(tmp_path / "yolo.onnx", {"out": np.zeros((1, 11, 40))})
    with pytest.raises(DetectorError, match="The detector mine failed: ValueError: the output has 11 columns"):
        detect(tmp_path, "model = 'yolo.onnx'\nskeleton = 'coco_17'\n[output]\nkind = 'yolo'\n")
    with pytest.raises(DetectorError, match="The detector mine failed: ValueError: cannot reshape"):
        detect(tmp_path, "model = 'yolo.onnx'\nskeleton = 'coco_17'\n")
