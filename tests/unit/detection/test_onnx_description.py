"""A description of an ONNX model is complete and checked before the model is opened."""

import pytest

from posefuse.detection.onnx_description import read_onnx_description
from posefuse.errors import PosefuseError


def description(folder, text):
    (folder / "model.onnx").write_bytes(b"")
    path = folder / "mine.toml"
    path.write_text(text)
    return path


def test_defaults_are_filled_in(tmp_path):
    found = read_onnx_description(description(tmp_path, "model = 'model.onnx'\nskeleton = 'coco_17'\n"))
    assert found["model"] == str(tmp_path / "model.onnx")
    assert (found["skeleton"], found["n_keypoints"], found["several_people"]) == ("coco_17", 17, False)
    assert (found["input"]["layout"], found["output"]["kind"]) == ("nchw", "points")


def test_a_skeleton_file_is_relative_to_the_description(tmp_path):
    (tmp_path / "own.toml").write_text("name = 'own'\nkeypoints = ['a', 'b']\n")
    found = read_onnx_description(description(tmp_path, "model = 'model.onnx'\nskeleton = 'own.toml'\n"))
    assert (found["skeleton"], found["n_keypoints"]) == (str(tmp_path / "own.toml"), 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("model = ", r"mine\.toml is not valid TOML"),
        ("model = 'model.onnx'", "needs 'skeleton'; it has model"),
        ("model = 'other.onnx'\nskeleton = 'coco_17'", r"there is no model .*other\.onnx"),
        ("model = 'model.onnx'\nskeleton = 'coco_18'", "Unknown skeleton"),
        ("model = 'model.onnx'\nskeleton = []", "skeleton has the wrong form"),
        ("model = 'model.onnx'\nskelton = 1\nskeleton = 'coco_17'", "unknown key 'skelton'. Did you mean 'skeleton'"),
        ("model = 'model.onnx'\nskeleton = 'coco_17'\ninput = 3", r"\[input\] must be a table"),
        ("model = 'model.onnx'\nskeleton = 'coco_17'\n[input]\nsize_px = [3]", r"\[input\]: size_px .* a width and a"),
        ("model = 'model.onnx'\nskeleton = 'coco_17'\n[input]\nstd = [1, 0, 1]", r"three positive numbers"),
        ("model = 'model.onnx'\nskeleton = 'coco_17'\n[output]\nkind = 'map'", "kind must be one of points, yolo"),
        ("model = 'model.onnx'\nskeleton = 'coco_17'\n[output]\norder = 'xz'", "order of the letters"),
        ("model = 'model.onnx'\nskeleton = 'coco_17'\n[output]\nmin_score = 'high'", "min_score has the wrong form"),
    ],
)
def test_a_wrong_description_is_one_sentence_that_names_the_key(tmp_path, text, message):
    with pytest.raises(PosefuseError, match=message):
        read_onnx_description(description(tmp_path, text))
