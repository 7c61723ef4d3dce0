"""Band factorization, solution and inverse against the dense matrix."""

import numpy as np
import pytest

from posefuse.kernels.trajectory.band import REACH
from posefuse.kernels.trajectory.band_inverse import invert_paths
from posefuse.kernels.trajectory.blocks import empty_blocks, from_blocks, to_blocks
from posefuse.kernels.trajectory.bone_solve import Groups, Stopping, Vectors, solve_with_bones
from posefuse.kernels.trajectory.bone_terms import BoneTerms
from tests.unit.kernels.trajectory.dense import block_of, factor_of, random_path, system_of, tiles_of

NO_BONES = np.zeros((0, 2), dtype=np.int64)


@pytest.mark.no_jit
@pytest.mark.parametrize(("paths", "frames"), [(2, 1), (2, 2), (3, 4), (2, 16), (9, 17), (10, 50)])
def test_band_matches_the_dense_matrix(paths, frames):
    rng = np.random.default_rng(frames)
    dense = [random_path(rng, frames) for _ in range(paths)]
    tiles = tiles_of(list(rng.permutation(paths)))
    factor = factor_of(*system_of(dense), tiles, frames)
    right = rng.standard_normal((paths, frames, 3))
    vectors = Vectors.of(to_blocks(right), frames)
    groups = Groups(tiles, np.zeros(0, dtype=np.int64), np.array([[len(tiles), 0]]))
    nothing = BoneTerms(*(empty_blocks(0, frames, rows) for rows in (3, 1, 1)), empty_blocks(paths, frames, 6))
    rounds = solve_with_bones(factor, groups, NO_BONES, nothing, Stopping(9, 0.0, 0.0), vectors)
    assert rounds == 1
    expected = np.stack([np.linalg.solve(a, b.ravel()).reshape(-1, 3) for a, b in zip(dense, right, strict=True)])
    assert np.allclose(from_blocks(vectors.steps, frames), expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())
    covariance, traces = np.empty((paths, frames, 3, 3)), np.empty((paths, REACH + 1, frames))
    invert_paths(factor, tiles, covariance, traces)
    for own, trace, inverse in zip(covariance, traces, map(np.linalg.inv, dense), strict=True):
        expected = [block_of(inverse, f, 0) for f in range(frames)]
        limit = 1e-8 * np.abs(expected).max()
        np.testing.assert_allclose(own, expected, rtol=1e-6, atol=limit)
        for m in range(min(REACH + 1, frames)):
            expected = [np.trace(block_of(inverse, f, m)) for f in range(m, frames)]
            np.testing.assert_allclose(trace[m, : frames - m], expected, rtol=1e-6, atol=limit)


def test_undetermined_directions_stay_finite():
    frames = 20
    diagonal, coupling = system_of([np.zeros((3 * frames, 3 * frames))] * 2)
    factor = factor_of(diagonal, coupling, tiles_of([0, 1]), frames)
    assert np.isfinite(factor).all()
