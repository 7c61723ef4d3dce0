"""Limbs between core keypoints: they keep their length in every pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kernels.tracking import body_kinematics
from posefuse.kernels.tracking.records import Pose
from posefuse.skeleton.limbs import core_limbs
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.tracking.body_states import body_of
from tests.kernels import from_python

locate = from_python(body_kinematics.locate_nodes)


def test_limbs_of_a_person_are_the_bones_and_the_widths_of_the_core() -> None:
    skeleton = shipped_skeleton("body_20")
    tree = skeleton.tree
    assert tree is not None
    limbs = core_limbs(skeleton, tree)
    names = {tuple(skeleton.keypoints[k] for k in pair) for pair in limbs.keypoints}
    sides = [("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle")]
    bones = {(f"{side}_{a}", f"{side}_{b}") for a, b in sides for side in ("left", "right")}
    assert names == bones | {("left_shoulder", "right_shoulder"), ("left_hip", "right_hip")}
    np.testing.assert_array_equal(limbs.mirror[limbs.mirror], np.arange(len(limbs)))
    assert (limbs.mirror != np.arange(len(limbs))).sum() == len(bones)


@pytest.mark.parametrize("name", ["body_20", "halpe_26", "coco_17"])
def test_lengths_do_not_depend_on_the_pose(name: str, rng: np.random.Generator) -> None:
    skeleton = shipped_skeleton(name)
    tree = skeleton.tree
    assert tree is not None
    limbs = core_limbs(skeleton, tree)
    assert len(limbs) >= 6
    for _ in range(3):
        shape = tree.shape_m * rng.uniform(0.8, 1.2, tree.n_shape)
        turns = Rotation.random(len(tree.segments), rng=rng).as_matrix()
        bones = Rotation.random(len(tree.bones), rng=rng).as_matrix()
        points = np.empty((len(tree.nodes), 3))
        locate(body_of(tree), Pose(rng.normal(size=3), turns, bones, shape), points)
        actual = np.linalg.norm(points[limbs.nodes[:, 1]] - points[limbs.nodes[:, 0]], axis=-1)
        np.testing.assert_allclose(limbs.lengths_m(tree, shape), actual, rtol=1e-9)
