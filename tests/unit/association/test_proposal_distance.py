"""Distance d_prop between proposals, against a loop over its equation."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from posefuse.association.proposal_distance import CorePoses, core_poses, proposal_distance
from posefuse.association.trunk import full, six
from posefuse.model.options.specification import SpecificationOptions
from posefuse.skeleton.skeletons import shipped_skeleton

SKELETON = shipped_skeleton("body_20")
CORE, PELVIS = SKELETON.core_indices, SKELETON.index("mid_hip")
PLAIN = SpecificationOptions()
NORMALIZED = replace(PLAIN, normalized_distance=True)


def person(rng: np.random.Generator, sd_m: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """Return points and covariances of a proposal with one missing core keypoint."""
    points = rng.normal(scale=0.5, size=(len(SKELETON), 3))
    factor = rng.normal(scale=sd_m, size=(len(SKELETON), 3, 3))
    points[CORE[int(rng.integers(len(CORE)))]] = np.nan
    return points, six(factor @ np.swapaxes(factor, 1, 2))


def naive(
    one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray], options: SpecificationOptions
) -> float:
    """Return d_prop, term by term."""
    (a, spread_a), (b, spread_b) = one, other
    spread_a, spread_b = full(spread_a), full(spread_b)

    def squared(difference: np.ndarray, covariance: np.ndarray, tau_m: float) -> float:
        matrix = tau_m**2 * np.eye(3) + (covariance if options.normalized_distance else 0.0)
        return float(difference @ np.linalg.inv(matrix) @ difference)

    total = squared(a[PELVIS] - b[PELVIS], spread_a[PELVIS] + spread_b[PELVIS], options.tau_root_m)
    for i in CORE:
        if np.isfinite(a[i] + b[i]).all():
            difference = (a[i] - a[PELVIS]) - (b[i] - b[PELVIS])
            spread = spread_a[i] + spread_a[PELVIS] + spread_b[i] + spread_b[PELVIS]
            total += options.core_weight * squared(difference, spread, options.tau_core_m)
    return total


def poses(people: tuple[np.ndarray, np.ndarray]) -> CorePoses:
    return core_poses(*people, SKELETON)


@pytest.mark.parametrize("options", [NORMALIZED, PLAIN], ids=["normalized", "plain"])
@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_distance_is_that_of_the_equation(options: SpecificationOptions, seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = person(rng), person(rng)
    expected = naive(one, other, options)
    assert proposal_distance(poses(one), poses(other), options) == pytest.approx(expected, rel=1e-9)
    assert proposal_distance(poses(other), poses(one), options) == pytest.approx(expected, rel=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_distance_does_not_depend_on_the_world_axes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(rng=rng), rng.uniform(-3.0, 3.0, 3)
    pairs = [person(rng), person(rng)]
    matrix = turn.as_matrix()
    turned = [(turn.apply(points) + shift, six(matrix @ full(spread) @ matrix.T)) for points, spread in pairs]
    apart, same = (proposal_distance(poses(a), poses(b), NORMALIZED) for a, b in (pairs, turned))
    assert same == pytest.approx(float(apart), rel=1e-6)


def test_uncertain_depth_counts_less_only_if_normalized(rng: np.random.Generator) -> None:
    """Two proposals that differ along an uncertain ray by one sd are close only with the normalized distance."""
    points, spread = person(rng, 0.001)
    deep = full(spread)
    deep[:, 0, 0] += 1.0
    there = points + np.array([1.0, 0.0, 0.0])
    sure, unsure = (
        (poses((points, spread)), poses((there, spread))),
        (poses((points, six(deep))), poses((there, spread))),
    )
    assert proposal_distance(*unsure, PLAIN) == pytest.approx(float(proposal_distance(*sure, PLAIN)), rel=1e-12)
    assert proposal_distance(*unsure, NORMALIZED) < 1.0 < 10.0 < proposal_distance(*sure, NORMALIZED)


def test_certain_proposals_have_the_plain_distance(rng: np.random.Generator) -> None:
    one, other = ((points, np.zeros_like(spread)) for points, spread in (person(rng), person(rng)))
    expected = float(proposal_distance(poses(one), poses(other), PLAIN))
    assert proposal_distance(poses(one), poses(other), NORMALIZED) == pytest.approx(expected, rel=1e-12)


def test_proposals_without_common_keypoints_are_infinitely_far(rng: np.random.Generator) -> None:
    one, (points, spread) = person(rng), person(rng)
    points[CORE] = np.nan
    assert proposal_distance(poses(one), poses((points, spread)), NORMALIZED) == np.inf


def test_root_is_the_middle_of_the_core_without_a_pelvis(rng: np.random.Generator) -> None:
    points, spread = person(rng)
    points[PELVIS] = np.nan
    np.testing.assert_allclose(core_poses(points, spread, SKELETON).root_m, np.nanmean(points[CORE], axis=0))
