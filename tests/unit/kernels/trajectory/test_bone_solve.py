"""The solve of paths that bones connect, compared with a dense solve."""

import numpy as np
import pytest

from posefuse.kernels.trajectory.blocks import empty_blocks, from_blocks, to_blocks
from posefuse.kernels.trajectory.bone_solve import Groups, Stopping, Vectors, solve_with_bones
from posefuse.kernels.trajectory.bone_terms import BoneTerms
from tests.unit.kernels.trajectory.dense import UPPER, factor_of, random_path, system_of, tiles_of

pytestmark = pytest.mark.no_jit
KEYPOINTS, FRAMES = 4, 18
BONES = np.array([[0, 1], [1, 2]])
TILES = np.concatenate([tiles_of([0, 1, 2]), tiles_of([3])])
GROUPS = Groups(TILES, np.array([0, 1]), np.array([[1, 2], [2, 2]]))


def test_steps_equal_those_of_a_dense_solve():
    rng = np.random.default_rng(0)
    paths = [random_path(rng, FRAMES, 1.0) + np.eye(3 * FRAMES) for _ in range(KEYPOINTS)]
    directions = rng.normal(size=(2, FRAMES, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    stiffness = rng.uniform(0.0, 20.0, (2, FRAMES))
    across = stiffness * rng.uniform(0.0, 1.0, stiffness.shape)
    stiffness[0, 2] = across[0, 2] = 0.0
    whole = np.zeros((KEYPOINTS, FRAMES, 3, KEYPOINTS, FRAMES, 3))
    for k, path in enumerate(paths):
        whole[k, :, :, k] = path.reshape(FRAMES, 3, FRAMES, 3)
    information = np.zeros((KEYPOINTS, FRAMES, 3, 3))
    for b, (one, other) in enumerate(BONES):
        for f in range(FRAMES):
            along = np.outer(directions[b, f], directions[b, f])
            block = stiffness[b, f] * along + across[b, f] * (np.eye(3) - along)
            for k, other_k, sign in ((one, one, 1), (other, other, 1), (one, other, -1), (other, one, -1)):
                whole[k, f, :, other_k, f] += sign * block
            information[one, f] += stiffness[b, f] * along
            information[other, f] += stiffness[b, f] * along
    own = to_blocks(information[..., *UPPER])
    diagonal, coupling = system_of(paths)
    factor = factor_of(diagonal + own, coupling, TILES, FRAMES)
    rhs = rng.normal(size=(KEYPOINTS, FRAMES, 3))
    vectors = Vectors.of(to_blocks(rhs), FRAMES)
    expected = np.linalg.solve(whole.reshape(3 * KEYPOINTS * FRAMES, -1), rhs.ravel()).reshape(rhs.shape)
    terms = BoneTerms(to_blocks(directions), to_blocks(stiffness[..., None]), to_blocks(across[..., None]), own)
    used = solve_with_bones(factor, GROUPS, BONES, terms, Stopping(100, 1e-12, 0.0), vectors)
    np.testing.assert_allclose(from_blocks(vectors.steps, FRAMES), expected, atol=1e-9)
    # A keypoint without bones needs one step, so the iterations are those of the others.
    assert 1 < used < 100


def test_negligible_residuals_end_the_iterations():
    rng = np.random.default_rng(1)
    paths = [random_path(rng, FRAMES, 1.0) + np.eye(3 * FRAMES) for _ in range(KEYPOINTS)]
    factor = factor_of(*system_of(paths), TILES, FRAMES)
    directions = np.full((2, FRAMES, 3), 0.3)
    terms = BoneTerms(
        to_blocks(directions), to_blocks(np.ones((2, FRAMES, 1))), to_blocks(np.zeros((2, FRAMES, 1))),
        to_blocks(np.zeros((KEYPOINTS, FRAMES, 6))),
    )  # fmt: skip
    rhs = np.ones((KEYPOINTS, FRAMES, 3)) * np.arange(1.0, 5.0)[:, None, None]
    used = [
        solve_with_bones(
            factor, GROUPS, BONES, terms, Stopping(100, 1e-9, negligible), Vectors.of(to_blocks(rhs), FRAMES)
        )
        for negligible in (0.0, 0.1, 10.0)
    ]  # fmt: skip
    assert used[0] > used[1] >= used[2] == 1


def test_an_undefined_keypoint_does_not_move_and_leaves_the_others_unchanged():
    rng = np.random.default_rng(2)
    paths = [random_path(rng, FRAMES) for _ in range(2)]
    tiles = tiles_of([0, 1])
    diagonal, coupling = system_of(paths)
    groups = Groups(tiles, np.zeros(0, dtype=np.int64), np.array([[1, 0]]))
    nothing = BoneTerms(*(empty_blocks(0, FRAMES, rows) for rows in (3, 1, 1)), empty_blocks(2, FRAMES, 6))
    found = []
    for value in (1.0, np.nan):
        rhs = np.ones((2, FRAMES, 3))
        rhs[1, 3] = value
        factor = factor_of(diagonal, coupling, tiles, FRAMES)
        bones = np.zeros((0, 2), dtype=np.int64)
        vectors = Vectors.of(to_blocks(rhs), FRAMES)
        solve_with_bones(factor, groups, bones, nothing, Stopping(9, 0.0, 0.0), vectors)
        found.append(from_blocks(vectors.steps, FRAMES))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    assert (found[1][1] == 0.0).all()
