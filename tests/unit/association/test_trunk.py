"""Centers of trunks."""

import numpy as np
import pytest

from posefuse.association.trunk import full, six, torso
from posefuse.skeleton.skeletons import Skeleton, find_skeleton


def spread_of(sigma_m: float, *shape: int) -> np.ndarray:
    return np.broadcast_to(six(np.eye(3) * sigma_m**2), (*shape, 6)).copy()


TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
COCO = find_skeleton("coco_17")
SMALL = six(np.broadcast_to(np.eye(3) * 1e-6, (1, 17, 3, 3)))


def standing(tilt: float = 0.0) -> np.ndarray:
    """Return a leaning trunk around (1, 2, 1.2), shape (1, 17, 3); other keypoints are missing."""
    points = np.full((1, 17, 3), np.nan)
    corners = [[-0.2, 0.0, 0.26], [0.2, 0.0, 0.26], [-0.13, 0.0, -0.26], [0.13, 0.0, -0.26]]
    lean = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(tilt), -np.sin(tilt)], [0.0, np.sin(tilt), np.cos(tilt)]])
    points[0, [COCO.index(name) for name in TRUNK]] = np.array(corners) @ lean.T + [1.0, 2.0, 1.2]
    return points


class TestTorso:
    @pytest.mark.parametrize("tilt", [0.0, 0.7, 1.5])
    def test_trunk_center_is_the_mean_of_four_corners(self, tilt):
        middle, spread = torso(COCO, standing(tilt), SMALL)
        np.testing.assert_allclose(middle, [[1.0, 2.0, 1.2]], atol=2e-3)
        assert np.sqrt(spread[0, [0, 3, 5]]).max() < 0.03

    @pytest.mark.parametrize("lost", TRUNK)
    def test_missing_landmark_increases_the_covariance(self, lost):
        points = standing()
        points[0, COCO.index(lost)] = np.nan
        middle, spread = torso(COCO, points, SMALL)
        off = middle[0] - [1.0, 2.0, 1.2]
        assert np.linalg.norm(off) < 0.06
        assert off @ np.linalg.solve(full(spread[0]), off) < 7.8

    def test_shoulders_alone_leave_the_center_uncertain_by_half_a_trunk(self):
        points = standing()
        points[0, [COCO.index("left_hip"), COCO.index("right_hip")]] = np.nan
        middle, spread = torso(COCO, points, SMALL)
        off = middle[0] - [1.0, 2.0, 1.2]
        assert np.linalg.norm(off) == pytest.approx(0.26, abs=0.01)
        assert off @ np.linalg.solve(full(spread[0]), off) < 7.8

    def test_outlier_hip_does_not_move_the_trunk(self):
        points = standing()
        points[0, COCO.index("left_hip")] += [0.0, 3.0, 0.0]
        middle, _ = torso(COCO, points, SMALL)
        assert np.linalg.norm(middle[0] - [1.0, 2.0, 1.2]) < 0.3

    def test_points_at_the_origin_are_valid(self):
        points = standing()
        points[0, COCO.index("left_hip")] = np.nan
        here, spread = torso(COCO, points, SMALL)
        other, same = torso(COCO, points + np.array([30.0, -20.0, 5.0]), SMALL)
        np.testing.assert_allclose(other - here, [[30.0, -20.0, 5.0]], atol=1e-9)
        np.testing.assert_allclose(spread, same, atol=1e-12)

    def test_no_people_have_no_trunk(self):
        middle, spread = torso(COCO, np.full((1, 17, 3), np.nan), np.full((1, 17, 6), np.nan))
        assert np.isnan(middle).all()
        assert np.isnan(spread).all()

    def test_trunk_of_an_animal_is_the_median_of_its_core(self):
        mouse = Skeleton("mouse", ("nose", "back", "tail"), core=("nose", "back", "tail"))
        points = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [9.0, 0.0, 0.0]]])
        middle, _ = torso(mouse, points, spread_of(0.1, 1, 3))
        assert middle.tolist() == [[1.0, 0.0, 0.0]]
