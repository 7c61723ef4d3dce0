"""Choice of the world of a refinement."""

import numpy as np
import pytest

from posefuse.calibration.gauge import align, apply_similarity, pose_changes, similarity_directions
from tests.scenes import ring

from .conftest import moved


def test_alignment_undoes_a_similarity_but_not_a_bumped_camera(rng):
    rig, points = ring(6), rng.normal(0.0, 1.0, (50, 3))
    bumped = moved(rig, "cam_4", x_m=0.1)
    step = np.array([0.02, -0.01, 0.03, 0.1, 0.05, -0.02, 0.01])
    elsewhere, other = apply_similarity(bumped, points, step, np.zeros(3))
    restored, restored_points = align(rig, elsewhere, other, np.ones(6, dtype=bool))
    left = np.linalg.norm(pose_changes(rig, restored)[:, 3:], axis=1)
    assert left[4] == pytest.approx(0.1, abs=0.01)
    assert np.delete(left, 4).max() < 0.01
    assert np.abs(restored.project(restored_points) - bumped.project(points)).max() < 1e-6


def test_similarities_leave_projections_unchanged(rng):
    rig, points = ring(3), rng.normal([0.0, 0.0, 1.0], 0.5, (20, 3))
    for k in range(7):
        step = np.eye(7)[k] * 1e-6
        after, other = apply_similarity(rig, points, step, np.zeros(3))
        assert np.abs(after.project(other) - rig.project(points)).max() < 1e-6
        assert np.allclose(pose_changes(rig, after), similarity_directions(rig, np.zeros(3)) @ step, atol=1e-11)
