"""Posterior lengths of bones."""

import numpy as np
import pytest

from posefuse.skeleton.from_names import skeleton_of
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.trajectory.bone_lengths import LengthPrior
from posefuse.trajectory.bones import Bones


@pytest.fixture(scope="module")
def human():
    skeleton = find_skeleton("halpe_26")
    bones = Bones.of(skeleton)
    names = [tuple(skeleton.keypoints[k] for k in ends) for ends in bones.ends]
    return LengthPrior.of(skeleton, bones), names


def test_every_bone_of_a_human_has_a_prior_length(human):
    prior, names = human
    lengths = dict(zip(names, prior.mean_m, strict=True))
    assert np.isfinite(prior.mean_m).all()
    assert lengths["left_hip", "left_knee"] == pytest.approx(0.43, abs=0.03)
    assert lengths["left_ankle", "left_big_toe"] == pytest.approx(0.18, abs=0.04)
    assert lengths["neck", "mid_hip"] == pytest.approx(0.48, abs=0.05)


def test_exact_measurements_are_kept(human):
    prior, _ = human
    measured = 1.3 * prior.mean_m
    length = prior.posterior_m(measured, np.full(len(measured), 1e-5))
    np.testing.assert_allclose(length, measured, rtol=1e-4)


def test_poor_measurements_follow_the_size_of_the_body(human):
    """The thighs, measured well, tell the size of all other bones."""
    prior, names = human
    large = 1.15 * prior.mean_m
    measured = large + 0.08 * np.where(np.arange(len(large)) % 2, 1.0, -1.0)
    sd = np.full(len(large), 0.08)
    for side in ("left", "right"):
        thigh = names.index((f"{side}_hip", f"{side}_knee"))
        measured[thigh], sd[thigh] = large[thigh], 0.002
    length = prior.posterior_m(measured, sd)
    assert np.abs(length - large).mean() < 0.4 * np.abs(measured - large).mean()


@pytest.mark.parametrize("unit", [0.01, 0.5, 2.0, 100.0, 1000.0])
def test_worlds_in_other_units_have_the_same_proportions(human, unit):
    prior, names = human
    noise = np.random.default_rng(0).standard_normal(len(names))
    sd = np.full(len(names), 0.02)
    expected = prior.posterior_m(prior.mean_m + 0.02 * noise, sd)
    length = prior.posterior_m(unit * (prior.mean_m + 0.02 * noise), unit * sd)
    np.testing.assert_allclose(length, unit * expected, rtol=0.1)
    errors = length / unit - prior.mean_m
    assert np.sqrt(np.square(errors).mean()) < 0.8 * 0.02 * np.sqrt(np.square(noise).mean())


def test_both_sides_share_their_lengths(human):
    prior, names = human
    one, other = names.index(("left_elbow", "left_wrist")), names.index(("right_elbow", "right_wrist"))
    measured, sd = np.full(len(names), np.nan), np.full(len(names), np.inf)
    measured[[one, other]], sd[[one, other]] = (0.20, 0.30), 0.04
    length = prior.posterior_m(measured, sd)
    assert abs(length[one] - length[other]) < 0.01
    assert np.isnan(np.delete(length, [one, other])).all()


def test_errors_shrink_at_every_level_of_noise(human):
    prior, names = human
    rng = np.random.default_rng(0)
    first = np.minimum(prior.mirror, np.arange(len(names)))
    for sd_m in (0.005, 0.02, 0.08):
        before, after = [], []
        for _ in range(100):
            body = rng.multivariate_normal(prior.mean_m, prior.covariance_m2)
            truth = body * (1.0 + 0.1 * rng.standard_normal(len(names)))[first]
            measured = truth + sd_m * rng.standard_normal(len(names))
            before.append(measured - truth)
            after.append(prior.posterior_m(measured, np.full(len(names), sd_m)) - truth)
        assert np.sqrt(np.mean(np.square(after))) < 0.9 * np.sqrt(np.mean(np.square(before)))


def test_animals_without_a_body_share_lengths_between_sides():
    edges = (("left_knee", "left_foot"), ("right_knee", "right_foot"), ("nose", "left_knee"))
    skeleton = skeleton_of("frog", ("nose", "left_knee", "left_foot", "right_knee", "right_foot"), edges)
    bones = Bones.of(skeleton)
    prior = LengthPrior.of(skeleton, bones)
    is_spine = prior.mirror == np.arange(len(bones.ends))
    assert is_spine.sum() == 1
    measured = np.where(is_spine, 0.5, 0.0)
    measured[~is_spine] = (0.04, 0.06)
    length = prior.posterior_m(measured, np.full(3, 0.01))
    assert np.ptp(length[~is_spine]) < 2e-3
    np.testing.assert_allclose(length[~is_spine].mean(), 0.05, atol=1e-3)
    np.testing.assert_allclose(length[is_spine], 0.5, atol=1e-3)
