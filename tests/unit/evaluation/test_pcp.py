"""PCP and PCK by hand."""

import numpy as np
import pytest

from posefuse.errors import ResultError
from posefuse.evaluation.head_points import JOINTS, joints_14
from posefuse.evaluation.pcp import PARTS, part_scores, pck
from posefuse.skeleton.skeletons import Skeleton, find_skeleton

BODY = {
    "nose": (0.1, 0.0, 1.6), "left_ear": (0.0, 0.08, 1.6), "right_ear": (0.0, -0.08, 1.6),
    "left_shoulder": (0.0, 0.2, 1.4), "right_shoulder": (0.0, -0.2, 1.4), "left_elbow": (0.0, 0.25, 1.1),
    "right_elbow": (0.0, -0.25, 1.1), "left_wrist": (0.0, 0.25, 0.85), "right_wrist": (0.0, -0.25, 0.85),
    "left_hip": (0.0, 0.12, 0.95), "right_hip": (0.0, -0.12, 0.95), "left_knee": (0.0, 0.12, 0.5),
    "right_knee": (0.0, -0.12, 0.5), "left_ankle": (0.0, 0.12, 0.08), "right_ankle": (0.0, -0.12, 0.08),
}  # fmt: skip
COCO = find_skeleton("coco_17")


def body() -> np.ndarray:
    """Shape (17, 3), without eyes."""
    return np.array([BODY.get(name, (np.nan,) * 3) for name in COCO.keypoints])


def joint(joints: np.ndarray, name: str) -> np.ndarray:
    return joints[..., JOINTS.index(name), :]


def test_order_of_joints():
    """COCO's places of the first twelve, as the recipe lists them."""
    places = [COCO.index(name) for name in JOINTS[:12]]
    assert places == [16, 14, 12, 11, 13, 15, 10, 8, 6, 5, 7, 9]


def test_head_points_match_hand_computed_values():
    """Shoulders at 1.4 m, ears at 1.6 m, the nose 0.1 m before them."""
    campus = joints_14(body(), COCO, "campus")
    np.testing.assert_allclose(joint(campus, "bottom_head"), [0, 0, 1.5])
    np.testing.assert_allclose(joint(campus, "top_head"), [0, 0, 1.7], atol=1e-12)
    shelf = joints_14(body(), COCO, "shelf", "z")
    np.testing.assert_allclose(joint(shelf, "bottom_head"), [0.75 * 0.05, 0, 1.5], atol=1e-12)
    np.testing.assert_allclose(joint(shelf, "top_head"), [0.75 * 0.075, 0, 0.75 * 1.7 + 0.25 * 1.7], atol=1e-12)
    assert np.isnan(joints_14(body(), COCO, "none")[12:]).all()
    with pytest.raises(ResultError, match="with z up"):
        joints_14(body(), COCO, "shelf", "-y")
    with pytest.raises(ResultError, match="Did you mean 'shelf'"):
        joints_14(body(), COCO, "self")  # type: ignore[arg-type]


def test_existing_head_keypoint_is_used():
    own = Skeleton("shelf", JOINTS)
    points = np.arange(42.0).reshape(14, 3)
    np.testing.assert_array_equal(joints_14(points, own, "campus"), points)


def test_score_of_one_part_matches_hand_computed_values():
    """A lower arm of 0.25 m: the wrist may be 0.25 m off and not more; the head's ends 0.1 m each."""
    truth = joints_14(body(), COCO, "campus")[None, None]
    for off, correct in ((0.24, 1.0), (0.26, 0.0)):
        actual = truth.copy()
        actual[..., JOINTS.index("right_wrist"), 0] += off
        scores = part_scores(actual, truth, "campus")
        assert scores.by_part[PARTS.index("right_lower_arm")] == correct
        assert scores.by_actor == (pytest.approx(0.9 + 0.1 * correct),)
    for off, correct in ((0.09, 1.0), (0.11, 0.0)):
        actual = truth.copy()
        actual[..., 12:, 0] += off
        scores = part_scores(actual, truth, "campus")
        assert scores.by_part[PARTS.index("head")] == correct
        assert scores.by_part[PARTS.index("torso")] == 1


def test_without_a_head_eight_parts_count():
    truth = joints_14(body(), COCO, "campus")[None, None]
    actual = joints_14(body(), COCO, "none")[None, None]
    actual[..., 0, 0] += 1.0
    scores = part_scores(actual, truth, "none")
    assert scores.by_actor == (pytest.approx(7 / 8),)
    assert np.isnan(scores.by_part[-2:]).all()


def test_closest_person_counts_at_any_distance_and_repeatedly():
    truth = np.stack([joints_14(body() + np.array([x, 0, 0]), COCO, "campus") for x in (0.0, 0.02, 3.0, 6.0)])[None]
    actual = joints_14(body(), COCO, "campus")[None, None]
    scores = part_scores(actual, truth, "campus")
    assert scores.by_actor == (1, 1, 0, 0)
    assert scores.average == pytest.approx(2 / 4)
    assert scores.average_first_three == pytest.approx(2 / 3)
    assert scores.recall_500 == pytest.approx(2 / 4)


def test_missing_joints_people_and_truth():
    truth = np.repeat(joints_14(body(), COCO, "campus")[None, None], 4, axis=0)
    actual = truth.copy()
    actual[0, 0, JOINTS.index("left_ankle")] = np.nan
    actual[1] = np.nan
    truth[2] = np.nan
    scores = part_scores(actual, truth, "campus")
    assert scores.n_person_frames == 3
    assert scores.by_actor == (pytest.approx((9 + 0 + 10) / 30),)
    assert scores.recall_500 == pytest.approx(2 / 3)
    empty = part_scores(actual[:, :0], truth, "campus")
    assert (empty.average, empty.recall_500) == (0, 0)


def test_pck_counts_missing_keypoints_as_wrong():
    truth = np.zeros((1, 1, 4, 3))
    truth[0, 0, 3] = np.nan
    actual = truth.copy()
    actual[0, 0, 0, 0] = 0.08
    actual[0, 0, 1] = np.nan
    assert pck(actual, truth, (0.05, 0.1)) == (pytest.approx(1 / 3), pytest.approx(2 / 3))
    assert np.isnan(pck(actual, np.full_like(truth, np.nan), (0.05,))[0])
