"""Kinematic trees from edges."""

import numpy as np
import pytest

from posefuse.errors import SkeletonError
from posefuse.skeleton.skeletons import parse_skeleton
from posefuse.skeleton.trees import Tree
from posefuse.skeleton.trees_from_edges import spanning_tree

EDGES = np.array([[0, 1], [0, 2], [3, 1], [4, 2], [0, 5], [3, 4]])


def ring(spread: float = 0.1) -> Tree:
    """a-b-d, a-c-e, a-f, d-e: b and c, d and e are partners, and d-e closes a ring; g hangs on nothing."""
    lengths = np.array([1.0, 1.2, 2.0, 2.4, 3.0, 4.0])
    return spanning_tree(list("abcdefg"), EDGES, lengths, spread, 5.0, np.array([0, 2, 1, 4, 3, 5, 6]))


def test_edges_form_a_tree_of_bones():
    tree = ring()
    assert tree.nodes[0].name == "a"
    parents = {node.name: tree.nodes[node.parent].name for node in tree.nodes[1:]}
    assert parents == {"b": "a", "c": "a", "f": "a", "d": "b", "e": "c"}
    assert tree.keypoint_nodes[-1] == -1
    assert (tree.n_pose, tree.size_m) == (3 + 2 * 5, 5.0)


def test_mirrored_edges_share_one_length():
    tree = ring(0.3)
    assert tree.shape_names == ("b", "f", "d")
    np.testing.assert_allclose(tree.shape_m, [1.0, 3.0, 2.0])
    np.testing.assert_allclose(np.diag(tree.shape_covariance), 2.0 * (0.3 * np.asarray(tree.shape_m)) ** 2)
    assert tree.nodes[tree.node("c")].place_m[2] == 1.0


def test_tree_from_edges_with_known_size():
    text = 'name = "worm"\nkeypoints = ["head", "middle", "tail"]\nedges = [["head", "middle"], ["middle", "tail"]]\n'
    tree = parse_skeleton(f"{text}[tree]\nsize_m = 0.02", "worm.toml").tree
    assert tree is not None
    assert (tree.size_m, tree.nodes[0].name, tree.n_pose) == (0.02, "middle", 7)
    assert parse_skeleton(text, "worm.toml").tree is None
    with pytest.raises(SkeletonError, match="no edges to use as bones"):
        parse_skeleton('name = "dots"\nkeypoints = ["a", "b"]\n[tree]\nsize_m = 1.0', "dots.toml")
    with pytest.raises(SkeletonError, match="tree.size_m must be a positive number, got 0"):
        parse_skeleton(f"{text}[tree]\nsize_m = 0", "worm.toml")
