"""The solve of paths that bones connect, compared with a dense solve."""

import numpy as np
import pytest

from posefuse.kernels.trajectory.band import REACH, factor_paths
from posefuse.kernels.trajectory.bone_terms import BoneTerms, Components, PathFactor, Stopping, solve_with_bones

pytestmark = pytest.mark.no_jit
KEYPOINTS, FRAMES = 4, 6
BONES = np.array([[0, 1], [1, 2]])
COMPONENTS = Components(np.array([0, 1, 2, 3]), np.array([0, 1]), np.array([[3, 2], [4, 2]]))


def dense_path(rng) -> np.ndarray:
    """Return a positive definite matrix of one path within the band, shape (frame, 3, frame, 3)."""
    rows = rng.normal(size=(4 * FRAMES, FRAMES, 3))
    for i, row in enumerate(rows):
        first = i % (FRAMES - REACH)
        row[np.r_[:first, first + REACH + 1 : FRAMES]] = 0.0
    matrix = np.einsum("nfi,ngj->figj", rows, rows)
    return matrix + np.eye(3 * FRAMES).reshape(FRAMES, 3, FRAMES, 3)


def band_of(matrix: np.ndarray) -> np.ndarray:
    """Return the blocks of a path in the layout of the band."""
    band = np.zeros((FRAMES, REACH + 1, 3, 3))
    for f in range(FRAMES):
        for m in range(min(REACH, f) + 1):
            band[f, m] = matrix[f, :, f - m]
    return band


def test_steps_equal_those_of_a_dense_solve():
    rng = np.random.default_rng(0)
    paths = [dense_path(rng) for _ in range(KEYPOINTS)]
    directions = rng.normal(size=(2, FRAMES, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    stiffness = rng.uniform(0.0, 20.0, (2, FRAMES))
    across = stiffness * rng.uniform(0.0, 1.0, stiffness.shape)
    stiffness[0, 2] = across[0, 2] = 0.0
    whole = np.zeros((KEYPOINTS, FRAMES, 3, KEYPOINTS, FRAMES, 3))
    for k, path in enumerate(paths):
        whole[k, :, :, k] = path
    information = np.zeros((KEYPOINTS, FRAMES, 3, 3))
    for b, (one, other) in enumerate(BONES):
        for f in range(FRAMES):
            along = np.outer(directions[b, f], directions[b, f])
            block = stiffness[b, f] * along + across[b, f] * (np.eye(3) - along)
            for k, other_k, sign in ((one, one, 1), (other, other, 1), (one, other, -1), (other, one, -1)):
                whole[k, f, :, other_k, f] += sign * block
            information[one, f] += stiffness[b, f] * along
            information[other, f] += stiffness[b, f] * along
    band = np.stack([band_of(path) for path in paths])
    band[:, :, 0] += information
    lower, inverse = np.empty((KEYPOINTS, FRAMES, REACH, 3, 3)), np.empty((KEYPOINTS, FRAMES, 3, 3))
    factor_paths(band, lower, inverse, np.empty(KEYPOINTS))
    rhs, steps = rng.normal(size=(KEYPOINTS, FRAMES, 3)), np.empty((KEYPOINTS, FRAMES, 3))
    expected = np.linalg.solve(whole.reshape(3 * KEYPOINTS * FRAMES, -1), rhs.ravel()).reshape(rhs.shape)
    terms = BoneTerms(COMPONENTS, BONES, directions, stiffness, across, information)
    used = solve_with_bones(PathFactor(lower, inverse), terms, rhs, Stopping(100, 1e-12, 0.0), steps)
    np.testing.assert_allclose(steps, expected, atol=1e-9)
    # A keypoint without bones needs one step, so the iterations are those of the others.
    assert 1 < used < 100


def test_negligible_residuals_end_the_iterations():
    rng = np.random.default_rng(1)
    band = np.stack([band_of(dense_path(rng)) for _ in range(KEYPOINTS)])
    lower, inverse = np.empty((KEYPOINTS, FRAMES, REACH, 3, 3)), np.empty((KEYPOINTS, FRAMES, 3, 3))
    factor_paths(band, lower, inverse, np.empty(KEYPOINTS))
    terms = BoneTerms(
        COMPONENTS, BONES, np.ones((2, FRAMES, 3)), np.ones((2, FRAMES)), np.zeros((2, FRAMES)),
        np.zeros((KEYPOINTS, FRAMES, 3, 3)),
    )  # fmt: skip
    used = [
        solve_with_bones(
            PathFactor(lower, inverse), terms, np.ones((KEYPOINTS, FRAMES, 3)), Stopping(100, 1e-9, negligible),
            np.empty((KEYPOINTS, FRAMES, 3)),
        )
        for negligible in (0.0, 0.1, 10.0)
    ]  # fmt: skip
    assert used[0] > used[1] >= used[2] == 1
