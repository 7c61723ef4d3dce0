"""Weights by a working correlation reduce the errors of poses, and the covariance follows."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.clock_coverage import simulate

from posefuse.calibration.joint.estimate import PRIOR_SD, JointEstimate, estimate
from posefuse.calibration.joint.noise_law import NoiseLaw
from posefuse.calibration.joint.prior import Prior
from posefuse.calibration.joint.reweighted import overstated, reweighted


def pose_errors(joint: JointEstimate, truth: np.ndarray) -> np.ndarray:
    return (joint.projection @ (joint.change - truth).ravel()).reshape(truth.shape)[:, :6]


def test_poses_of_a_walking_person_are_more_accurate():
    """The gain in 12 s is a quarter on average; the sum over 4 recordings hides the chance of each."""
    before, after, normalized = [], [], []
    for seed in range(4):
        recording, truth = simulate("walks", 12.0, np.random.default_rng([seed, 8]))
        prior = Prior.of_sds(np.tile(PRIOR_SD, (recording.n_views, 1)))
        joint = estimate(recording, max_samples=120, prior=prior)
        assert joint is not None
        again = reweighted(joint, recording, prior)
        before.append(np.square(pose_errors(joint, truth)[:, :3]).mean())
        after.append(np.square(pose_errors(again, truth)[:, :3]).mean())
        normalized.append((pose_errors(again, truth) / again.sd[:, :6]).ravel())
        np.testing.assert_array_equal(joint.change[:, 6:], again.change[:, 6:])
        np.testing.assert_array_equal(joint.sd[:, 6:], again.sd[:, 6:])
        assert np.median(again.sd[:, :3]) < np.median(joint.sd[:, :3])
    assert np.sum(after) < np.sum(before)
    assert 0.6 < np.sqrt(np.mean(np.square(np.concatenate(normalized)))) < 1.5


def covariance_matrix(rng: np.random.Generator, size: float) -> np.ndarray:
    root = rng.standard_normal((6, 12))
    return size * root @ root.T


def test_observations_and_known_poses_are_combined_with_minimum_variance(rng):
    """The combination of certain observations and a prior has the covariance of generalized least squares."""
    curvature, scores = covariance_matrix(rng, 1e4), covariance_matrix(rng, 1e6)
    precision = covariance_matrix(rng, 1e2)
    curvature, weight = overstated(curvature, scores, precision)
    spread = np.linalg.inv(curvature + weight @ precision)
    found = spread @ (scores + weight @ precision @ weight.T) @ spread.T
    best = np.linalg.inv(curvature @ np.linalg.solve(scores, curvature) + precision)
    assert found == pytest.approx(best, rel=0.05, abs=0.05 * np.abs(best).max())
    plain = np.linalg.inv(curvature + precision)
    assert np.trace(plain @ (scores + precision) @ plain) > 1.1 * np.trace(best)


def test_known_poses_keep_their_weight_without_observations(rng):
    nothing, precision = np.zeros((6, 6)), covariance_matrix(rng, 1.0)
    _, weight = overstated(nothing, nothing, precision)
    assert weight == pytest.approx(np.eye(6), abs=1e-9)


def test_weights_follow_the_share_of_errors_that_persist(walk):
    """Slow errors in the working correlation cost certainty where the errors have none."""
    recording = walk[0]
    prior = Prior.of_sds(np.tile(PRIOR_SD, (recording.n_views, 1)))
    joint = estimate(recording, prior=prior)
    assert joint is not None
    joint = replace(joint, law=NoiseLaw(0.0))
    measured, fixed = (reweighted(joint, recording, prior, working) for working in (None, NoiseLaw(0.1)))
    assert np.median(measured.sd[:, :3]) < 0.99 * np.median(fixed.sd[:, :3])


def test_errors_of_clocks_reach_the_poses(walk):
    """Poses follow a clock that is off by 10 ms, and their covariance with uncertain clocks states it."""
    recording = walk[0]
    n = recording.n_views
    prior = Prior.of_sds(np.tile(PRIOR_SD, (n, 1)))
    joint = estimate(recording, prior=prior)
    assert joint is not None
    late = np.zeros((n, 8))
    late[:, 6] = 0.01 * (np.arange(n) == 1) - 0.01 / n
    ends = [
        reweighted(replace(joint, parameters=joint.parameters.changed(sign * late)), recording, prior).change
        for sign in (-0.5, 0.5)
    ]
    moved = (ends[1] - ends[0])[:, :6].ravel()
    is_clock = np.tile(np.arange(8) >= 6, n)
    uncertain = np.outer(late, late) + joint.covariance * ~np.outer(is_clock, is_clock)
    nothing = np.where(is_clock[:, None], 0.0, joint.response)
    again = reweighted(replace(joint, covariance=uncertain, response=nothing), recording, prior)
    fixed = reweighted(replace(joint, covariance=uncertain - np.outer(late, late), response=nothing), recording, prior)
    added = (again.covariance - fixed.covariance)[~is_clock][:, ~is_clock]
    stated = np.sqrt(np.diag(added))
    assert np.abs(moved).max() > np.radians(0.05)
    np.testing.assert_allclose(stated, np.abs(moved), rtol=0.25, atol=0.1 * np.abs(moved).max())
    assert np.linalg.eigvalsh(reweighted(joint, recording, prior).covariance)[0] > -1e-9
