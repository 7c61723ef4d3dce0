"""Covariance-normalized distances between people, and centers of trunks."""

import numpy as np
import pytest

from posefuse.association.clusters import cluster, distance_squared
from posefuse.association.trunk import full, six, torso
from posefuse.skeleton.skeletons import Skeleton, find_skeleton

TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
COCO = find_skeleton("coco_17")
SMALL = six(np.broadcast_to(np.eye(3) * 1e-6, (1, 17, 3, 3)))


def spread_of(sigma_m: float, *shape: int) -> np.ndarray:
    return np.broadcast_to(six(np.eye(3) * sigma_m**2), (*shape, 6)).copy()


def standing(tilt: float = 0.0) -> np.ndarray:
    """Return a leaning trunk around (1, 2, 1.2), shape (1, 17, 3); other keypoints are missing."""
    points = np.full((1, 17, 3), np.nan)
    corners = [[-0.2, 0.0, 0.26], [0.2, 0.0, 0.26], [-0.13, 0.0, -0.26], [0.13, 0.0, -0.26]]
    lean = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(tilt), -np.sin(tilt)], [0.0, np.sin(tilt), np.cos(tilt)]])
    points[0, [COCO.index(name) for name in TRUNK]] = np.array(corners) @ lean.T + [1.0, 2.0, 1.2]
    return points


class TestDistance:
    def test_by_hand(self):
        a, b = np.zeros((1, 2, 3)), np.array([[[0.3, 0.0, 0.0], [0.0, 0.4, 0.0]]])
        # Variances add: 0.01 + 0.01; 0.09 / 0.02 and 0.16 / 0.02, and the mean of the two.
        found = distance_squared(a, spread_of(0.1, 1, 2), b, spread_of(0.1, 1, 2))
        assert found == pytest.approx(np.array([[6.25]]))

    def test_three_for_two_estimates_of_one_person_however_many_keypoints_are_common(self):
        rng = np.random.default_rng(0)
        factor = rng.normal(0.0, 0.05, (300, 17, 3, 3))
        spread = factor @ np.swapaxes(factor, -1, -2) + 0.01**2 * np.eye(3)
        draws = np.einsum("nkij,tnkj->tnki", np.linalg.cholesky(spread), rng.standard_normal((2, 300, 17, 3)))
        for common in (1, 5, 17):
            a, b = draws.copy()
            a[:, common:] = np.nan
            found = np.diagonal(distance_squared(a, six(spread), b, six(spread)))
            assert found.mean() == pytest.approx(3.0, abs=0.5)

    def test_turning_the_world_changes_nothing(self):
        rng = np.random.default_rng(1)
        a, b = rng.normal(size=(3, 5, 3)), rng.normal(size=(2, 5, 3))
        factor = rng.normal(size=(3, 5, 3, 3))
        spread = factor @ np.swapaxes(factor, -1, -2) + np.eye(3)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        before = distance_squared(a, six(spread), b, spread_of(0.2, 2, 5))
        after = distance_squared(a @ turn.T, six(turn @ spread @ turn.T), b @ turn.T, spread_of(0.2, 2, 5))
        np.testing.assert_allclose(before, after)

    def test_people_with_too_few_common_keypoints_have_no_distance(self):
        a, b = np.zeros((1, 3, 3)), np.zeros((1, 3, 3))
        a[0, 0], b[0, 2] = np.nan, np.nan
        own = spread_of(0.1, 1, 3)
        assert distance_squared(a, own, b, own)[0, 0] == 0.0
        assert np.isnan(distance_squared(a, own, b, own, min_common=2)[0, 0])
        b[0, 1] = np.nan
        assert np.isnan(distance_squared(a, own, b, own)[0, 0])

    def test_noise_floor_reduces_distances(self):
        a, b = np.zeros((1, 2, 3)), np.full((1, 2, 3), 0.03)
        own = spread_of(0.0, 1, 2)
        assert distance_squared(a, own, b, own, floor_m=0.03)[0, 0] == pytest.approx(3.0)

    def test_clusters_chain_and_are_counted_as_they_come(self):
        x = np.array([5.0, 0.0, 0.25, 5.1, 0.5])
        points = np.zeros((5, 2, 3))
        points[..., 0] = x[:, None]
        assert cluster(points, spread_of(0.1, 5, 2), 4.0).tolist() == [0, 1, 1, 0, 1]
        assert cluster(points, spread_of(0.1, 5, 2), 1.0).tolist() == [0, 1, 2, 0, 3]
        assert cluster(np.empty((0, 2, 3)), np.empty((0, 2, 6)), 1.0).shape == (0,)


class TestTorso:
    @pytest.mark.parametrize("tilt", [0.0, 0.7, 1.5])
    def test_the_middle_of_four_corners_however_it_leans(self, tilt):
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

    def test_shoulders_alone_leave_the_middle_uncertain_by_half_a_trunk(self):
        points = standing()
        points[0, [COCO.index("left_hip"), COCO.index("right_hip")]] = np.nan
        middle, spread = torso(COCO, points, SMALL)
        off = middle[0] - [1.0, 2.0, 1.2]
        assert np.linalg.norm(off) == pytest.approx(0.26, abs=0.01)
        assert off @ np.linalg.solve(full(spread[0]), off) < 7.8

    def test_a_hip_meters_away_does_not_carry_the_trunk_off(self):
        points = standing()
        points[0, COCO.index("left_hip")] += [0.0, 3.0, 0.0]
        middle, _ = torso(COCO, points, SMALL)
        assert np.linalg.norm(middle[0] - [1.0, 2.0, 1.2]) < 0.3

    def test_the_world_s_origin_is_nothing_special(self):
        points = standing()
        points[0, COCO.index("left_hip")] = np.nan
        here, spread = torso(COCO, points, SMALL)
        there, same = torso(COCO, points + np.array([30.0, -20.0, 5.0]), SMALL)
        np.testing.assert_allclose(there - here, [[30.0, -20.0, 5.0]], atol=1e-9)
        np.testing.assert_allclose(spread, same, atol=1e-12)

    def test_no_people_have_no_trunk(self):
        middle, spread = torso(COCO, np.full((1, 17, 3), np.nan), np.full((1, 17, 6), np.nan))
        assert np.isnan(middle).all()
        assert np.isnan(spread).all()

    def test_an_animal_has_the_median_of_its_core(self):
        mouse = Skeleton("mouse", ("nose", "back", "tail"), core=("nose", "back", "tail"))
        points = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [9.0, 0.0, 0.0]]])
        middle, _ = torso(mouse, points, spread_of(0.1, 1, 3))
        assert middle.tolist() == [[1.0, 0.0, 0.0]]
