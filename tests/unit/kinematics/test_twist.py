"""Rotations of bones with a twist."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.kinematics.twist import about_third_axis, bones_in_order, carrier, cross, full_rotations, rest_frames
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.skeleton.trees import Tree


def tree_of(name: str) -> Tree:
    tree = shipped_skeleton(name).tree
    assert tree is not None
    return tree


def random_pose(tree: Tree, rng: np.random.Generator, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Return random rotations of segments and directions of bones."""
    turns = Rotation.random(frames * len(tree.segments), rng=rng).as_matrix()
    directions = rng.normal(size=(frames, len(tree.bones), 3))
    return turns.reshape(frames, -1, 3, 3), directions / np.linalg.norm(directions, axis=-1, keepdims=True)


@pytest.mark.parametrize("name", ["body_20", "mouse_22", "fly_38"])
def test_frames_are_rotations_along_their_bones(name, rng):
    tree = tree_of(name)
    turns, directions = random_pose(tree, rng, 20)
    frames, _ = full_rotations(tree, turns, directions)
    np.testing.assert_allclose(frames[..., 2], directions, atol=1e-9)
    np.testing.assert_allclose(
        np.swapaxes(frames, -1, -2) @ frames, np.broadcast_to(np.eye(3), frames.shape), atol=1e-9
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-9)


def test_rest_pose_has_rest_frames():
    tree = tree_of("body_20")
    turns = np.tile(np.eye(3), (1, len(tree.segments), 1, 1))
    frames, unobserved = full_rotations(tree, turns, np.asarray(tree.rest)[None])
    np.testing.assert_allclose(frames[0][unobserved[0]], rest_frames(tree)[unobserved[0]], atol=1e-12)


def test_frames_turn_with_the_body(rng):
    tree = tree_of("body_20")
    turns, directions = random_pose(tree, rng, 10)
    turn = Rotation.random(rng=rng).as_matrix()
    frames, unobserved = full_rotations(tree, turns, directions)
    turned, still_unobserved = full_rotations(tree, turn @ turns, directions @ turn.T)
    np.testing.assert_allclose(turned, turn @ frames, atol=1e-6)
    np.testing.assert_array_equal(still_unobserved, unobserved)


def test_carriers_come_before_their_bones():
    tree = tree_of("fly_38")
    order = bones_in_order(tree)
    assert sorted(order) == list(range(len(tree.bones)))
    for place, bone in enumerate(order):
        before, _ = carrier(tree, bone)
        assert before < 0 or order.index(before) < place


def test_cross_product_equals_that_of_numpy(rng):
    first, second = rng.normal(size=(2, 5, 4, 3))
    np.testing.assert_allclose(cross(first, second), np.cross(first, second))
    np.testing.assert_allclose(about_third_axis(np.array([0.3]))[0], Rotation.from_euler("z", 0.3).as_matrix())
