"""Distribution of bone lengths conditioned on known lengths."""

import numpy as np
import pytest

from posefuse.errors import OptionsError
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.tracking.known_lengths import with_known_lengths

SKELETON = shipped_skeleton("body_20")
TREE = SKELETON.tree
assert TREE is not None
KNEE = TREE.shape_names.index("left_knee")


def test_skeleton_is_unchanged_without_known_lengths():
    assert with_known_lengths(SKELETON, TrackerOptions()) is SKELETON


@pytest.mark.parametrize("name", ["left_knee", "right_knee"])
def test_measured_thigh_has_the_measured_length(name):
    tree = with_known_lengths(SKELETON, TrackerOptions(known_m=(f"{name}=0.5",), known_sd_m=0.001)).tree
    assert tree.shape_m[KNEE] == pytest.approx(0.5, abs=1e-3)
    assert np.sqrt(tree.shape_covariance[KNEE, KNEE]) == pytest.approx(0.001, rel=0.01)
    # Thigh and shank lengths are correlated.
    ankle = TREE.shape_names.index("left_ankle")
    assert TREE.shape_m[ankle] < tree.shape_m[ankle] < TREE.shape_m[ankle] * 0.5 / TREE.shape_m[KNEE]
    assert np.linalg.eigvalsh(tree.shape_covariance).min() > 0.0


def test_conditioned_distribution_matches_sampled_bodies(rng):
    """Compare with sampled bodies that have about the given thigh length."""
    drawn = rng.multivariate_normal(TREE.shape_m, TREE.shape_covariance, 400_000)
    alike = drawn[np.abs(drawn[:, KNEE] - 0.46) < 0.002]
    tree = with_known_lengths(SKELETON, TrackerOptions(known_m=("left_knee=0.46",), known_sd_m=0.001)).tree
    np.testing.assert_allclose(alike.mean(axis=0), tree.shape_m, atol=2e-3)
    np.testing.assert_allclose(alike.std(axis=0), np.sqrt(np.diag(tree.shape_covariance)), atol=2e-3)


def test_stature_lengthens_all_bones():
    tree = with_known_lengths(SKELETON, TrackerOptions(stature_m=1.95)).tree
    assert tree.shape_m.sum() == pytest.approx(TREE.shape_m.sum() * 1.95 / 1.75, rel=0.02)
    big = TREE.shape_m > 0.1
    assert (tree.shape_m[big] > TREE.shape_m[big]).all()
    assert (np.diag(tree.shape_covariance) < np.diag(TREE.shape_covariance)).all()


def test_invalid_lengths_raise():
    with pytest.raises(OptionsError, match="no length 'left_nee'.*left_knee"):
        with_known_lengths(SKELETON, TrackerOptions(known_m=("left_nee=0.4",)))
    for wrong in ("left_knee", "left_knee=", "left_knee=tall", "left_knee=-1"):
        with pytest.raises(OptionsError, match="name=meters"):
            TrackerOptions(known_m=(wrong,))
    with pytest.raises(OptionsError, match="stature_m"):
        TrackerOptions(stature_m=0.0)
