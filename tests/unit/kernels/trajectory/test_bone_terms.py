"""Terms of bones, and the information that they transfer, compared with dense computations of single frames."""

import numpy as np
import pytest

from posefuse.kernels.trajectory.blocks import empty_blocks, from_blocks, matrices_from_blocks, to_blocks
from posefuse.kernels.trajectory.bone_terms import BonePrior, BoneTerms, add_bones, propagate_bone_information
from tests.unit.kernels.trajectory.dense import UPPER

pytestmark = pytest.mark.no_jit
KEYPOINTS, FRAMES = 4, 18
BONES = np.array([[0, 1], [1, 2], [1, 3]])
ORDER = np.array([[0, 1], [1, 1], [2, 1]])


def test_directions_stiffness_and_gradient():
    rng = np.random.default_rng(0)
    paths = rng.normal(size=(KEYPOINTS, FRAMES, 3))
    alive = rng.uniform(size=(KEYPOINTS, FRAMES)) < 0.8
    prior = BonePrior(BONES, np.array([1.0, 0.5, 0.0]), np.array([4.0, 2.0, 0.0]), np.array([0.3, np.inf, np.inf]))
    terms = BoneTerms(*(empty_blocks(3, FRAMES, rows) for rows in (3, 1, 1)), empty_blocks(KEYPOINTS, FRAMES, 6))
    rhs = to_blocks(np.zeros((KEYPOINTS, FRAMES, 3)))
    add_bones(prior, alive, paths, terms, rhs)
    difference = paths[BONES[:, 0]] - paths[BONES[:, 1]]
    length = np.linalg.norm(difference, axis=-1)
    error = length - prior.lengths[:, None]
    weight = np.square(1.0 / (1.0 + np.square(error) / prior.reach_squared[:, None]))
    stiffness = prior.stiffness[:, None] * weight * (alive[BONES[:, 0]] & alive[BONES[:, 1]])
    np.testing.assert_allclose(from_blocks(terms.stiffness, FRAMES)[..., 0], stiffness)
    across = stiffness * np.maximum(error, 0.0) / length
    np.testing.assert_allclose(from_blocks(terms.across, FRAMES)[..., 0], across)
    np.testing.assert_allclose(from_blocks(terms.directions, FRAMES), difference / length[..., None])
    expected = np.zeros((KEYPOINTS, FRAMES, 3))
    for b, (one, other) in enumerate(BONES):
        pull = (stiffness[b] * error[b] / length[b])[:, None] * difference[b]
        expected[one] -= pull
        expected[other] += pull
    np.testing.assert_allclose(from_blocks(rhs, FRAMES), expected, atol=1e-12)
    # Padding is not part of the system.
    assert (rhs.reshape(KEYPOINTS, 2, 3, -1)[:, 1, :, FRAMES - 16 :] == 0.0).all()


def test_bones_transfer_what_a_dense_system_marginalizes():
    rng = np.random.default_rng(1)
    views = rng.normal(size=(KEYPOINTS, FRAMES, 4, 3))
    information = np.einsum("kfai,kfaj->kfij", views, views)
    information[2, 5] = 0.0
    directions = rng.normal(size=(3, FRAMES, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    stiffness = rng.uniform(0.5, 5.0, (3, FRAMES))
    stiffness[0, 2] = 0.0
    along = to_blocks(stiffness[..., None])
    terms = BoneTerms(to_blocks(directions), along, np.zeros_like(along), empty_blocks(KEYPOINTS, FRAMES, 6))
    propagate_bone_information(BONES, ORDER, to_blocks(information[..., *UPPER]), terms)
    found = matrices_from_blocks(terms.information, FRAMES)
    for f in range(FRAMES):
        whole = np.zeros((KEYPOINTS, 3, KEYPOINTS, 3))
        for k in range(KEYPOINTS):
            whole[k, :, k] += information[k, f]
        for b, (one, other) in enumerate(BONES):
            block = stiffness[b, f] * np.outer(directions[b, f], directions[b, f])
            for k, other_k, sign in ((one, one, 1), (other, other, 1), (one, other, -1), (other, one, -1)):
                whole[k, :, other_k] += sign * block
        for k in range(KEYPOINTS):
            others = [n for n in range(KEYPOINTS) if n != k]
            rest = whole[others][:, :, others].reshape(9, 9)
            link = whole[k][:, others].reshape(3, 9)
            marginal = whole[k, :, k] - link @ np.linalg.pinv(rest) @ link.T
            np.testing.assert_allclose(information[k, f] + found[k, f], marginal, rtol=1e-4, atol=1e-4)
