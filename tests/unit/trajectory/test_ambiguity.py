"""Ambiguous positions from one view and a bone."""

import numpy as np
import pytest

from posefuse.trajectory.ambiguity import find_ambiguous, has_single_views
from posefuse.trajectory.bones import Bones
from posefuse.trajectory.paths import Paths
from tests.unit.trajectory.path_problems import ARM

FRAMES = 41
BONES = Bones.of(ARM)
LENGTHS_M = np.array([0.3, 0.25])


def turning(observed: np.ndarray) -> tuple[Paths, np.ndarray]:
    """A wrist passes its elbow across the view in frame 20; views look along x."""
    paths_m = np.zeros((3, FRAMES, 3))
    paths_m[0] = (0.0, 0.0, 0.3)
    angle = np.linspace(-1.0, 1.0, FRAMES)
    paths_m[2] = 0.25 * np.stack([np.sin(angle), np.cos(angle), np.zeros(FRAMES)], axis=-1)
    weights = np.ones((3, FRAMES, 2))
    weights[2, ~observed, 1] = 0.0
    jacobians = np.zeros((3, FRAMES, 2, 2, 3))
    jacobians[..., 0, 1] = jacobians[..., 1, 2] = 1000.0
    rows = np.ones((3, FRAMES - 3))
    paths = Paths(
        paths_m=paths_m,
        covariance_m2=np.broadcast_to(0.005**2 * np.eye(3), (3, FRAMES, 3, 3)),
        persistent_covariance_m2=np.zeros((3, FRAMES, 3, 3)),
        weights=weights,
        alive=np.ones((3, FRAMES), dtype=bool),
        variance_m2=np.full(3, 1e-4),
        density_factor=rows,
        squares=rows,
        determined=rows,
    )
    return paths, jacobians


@pytest.mark.parametrize("backward", [False, True])
def test_ambiguity_persists_after_positions_meet(backward):
    observed = np.arange(FRAMES) < 5
    actual = find_ambiguous(*turning(observed[::-1] if backward else observed), BONES, LENGTHS_M)
    assert not actual[:2].any()
    wrist = actual[2, ::-1] if backward else actual[2]
    # Twice 0.25 sin(angle) is less than eight times 5 mm within 0.08 rad, 1.6 frames, of the frame in the middle.
    assert (wrist == (np.arange(FRAMES) >= 19)).all()


def test_frame_with_two_views_resolves_the_ambiguity():
    observed = np.abs(np.arange(FRAMES) - 20) > 15
    assert not find_ambiguous(*turning(observed), BONES, LENGTHS_M).any()


def test_path_without_two_views_is_ambiguous():
    assert find_ambiguous(*turning(np.zeros(FRAMES, dtype=bool)), BONES, LENGTHS_M)[2].all()


def test_without_a_bone_no_point_is_ambiguous():
    observed = np.arange(FRAMES) < 5
    assert not find_ambiguous(*turning(observed), BONES, np.array([0.3, np.nan])).any()


def test_points_of_two_views_need_no_check():
    assert not has_single_views(turning(np.ones(FRAMES, dtype=bool))[0])
    assert has_single_views(turning(np.arange(FRAMES) != 7)[0])
