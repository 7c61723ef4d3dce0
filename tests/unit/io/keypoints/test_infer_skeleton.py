"""Inference of the skeleton from the number and layout of keypoints."""

import numpy as np
import pytest

from posefuse.errors import SkeletonError
from posefuse.io.keypoints.infer_skeleton import infer_skeleton, relative_bone_length
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate


def pixels_of(name: str) -> np.ndarray:
    scene = simulate(SceneOptions(skeleton=name, duration_s=0.5, cameras=3, detector=CLEAN))
    return np.asarray(scene.detections.keypoints_px)


@pytest.mark.parametrize("name", ["body_25", "body_25b"])
def test_shortest_bones_decide_between_skeletons_of_one_size(name):
    skeleton, notes = infer_skeleton(25, pixels_of(name), "x.json")
    assert skeleton.name == name
    assert f"25 keypoints read as {name}" in notes[0]


def test_relative_bone_length_is_independent_of_position_and_scale():
    skeleton, pixels = shipped_skeleton("body_25"), pixels_of("body_25")
    length = relative_bone_length(skeleton, pixels)
    assert 0.0 < length < 0.5
    assert relative_bone_length(skeleton, 3.0 * pixels + 100.0) == pytest.approx(length)
    assert relative_bone_length(skeleton, np.full_like(pixels, np.nan)) == np.inf


def test_unknown_number_of_keypoints_lists_the_shipped_skeletons():
    with pytest.raises(SkeletonError, match=r"x.json has 7 keypoints, but no shipped skeleton does: .*coco_17 \(17\)"):
        infer_skeleton(7, np.zeros((3, 7, 2)), "x.json")


def test_missing_detections_do_not_decide():
    with pytest.raises(SkeletonError, match="the detections do not determine which"):
        infer_skeleton(25, np.full((4, 25, 2), np.nan), "x.json")
