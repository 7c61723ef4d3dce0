"""Essential matrices from five rays."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from posefuse.calibration.people.five_point import decompose, essential_matrices
from posefuse.model.cameras import rotation_from_vector


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_true_pose_is_among_the_solutions(seed):
    rng = np.random.default_rng(seed)
    rotation = rotation_from_vector(rng.uniform(-2.0, 2.0, 3))
    translation = rng.standard_normal(3)
    translation /= np.linalg.norm(translation)
    points = rng.uniform(-1.0, 1.0, (4, 5, 3)) + np.array([0.0, 0.0, 4.0])
    moved = points @ rotation.T + 2.0 * translation
    found = essential_matrices(
        points / np.linalg.norm(points, axis=2, keepdims=True), moved / np.linalg.norm(moved, axis=2, keepdims=True)
    )
    true = np.cross(np.eye(3), translation) @ rotation / np.sqrt(2.0)
    distance = np.minimum(np.abs(found - true).max(axis=(1, 2)), np.abs(found + true).max(axis=(1, 2)))
    # Each of the four samples finds the pose, unless a sample is nearly degenerate.
    assert (distance < 1e-4).sum() >= 3
    rotations, directions = decompose(found[np.argmin(distance)])
    assert np.abs(rotations - rotation).max(axis=(1, 2)).min() < 1e-3
    assert abs(directions @ translation) > 1.0 - 1e-5


def test_solutions_are_essential_matrices_of_their_samples(rng):
    a, b = rng.standard_normal((2, 6, 5, 3))
    for k in range(6):
        found = essential_matrices(a[k : k + 1], b[k : k + 1])
        assert len(found) % 2 == 0
        assert np.abs(np.einsum("ki,nij,kj->nk", b[k], found, a[k])).max(initial=0.0) < 1e-8
        values = np.linalg.svd(found, compute_uv=False)
        np.testing.assert_allclose(values, np.broadcast_to([0.5**0.5, 0.5**0.5, 0.0], values.shape), atol=1e-5)
