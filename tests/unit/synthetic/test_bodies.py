"""Occlusion by capsules around bodies."""

import numpy as np

from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.bodies import Capsules, bodies_of, hidden_keypoints
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.rigs import build_rig

SKELETON = shipped_skeleton("coco_17")
RIG = build_rig("ring", 4)


def standing_people(*x_m: float) -> np.ndarray:
    """Return standing people at given places along x, shape (1, person, keypoint, 3)."""
    figure = human(1.75)
    motion = HumanMotion.random(("stand",), np.random.default_rng(0))
    points = motion.positions(figure, np.zeros(1))[:, figure.columns(SKELETON)]
    points[..., :2] -= points[..., :2].mean(axis=1, keepdims=True)
    return np.stack([points + np.array([x, 0.0, 0.0]) for x in x_m], axis=1)


def test_nothing_is_hidden_without_bodies():
    assert not hidden_keypoints(RIG, standing_people(0.0), Capsules.none(1)).any()


def test_person_hides_the_one_behind():
    points = standing_people(0.0, 0.8)
    other = bodies_of(points[:, :1], SKELETON)
    hidden = hidden_keypoints(RIG, points, other)[0]
    centers = np.array([camera.center_m for camera in RIG.cameras])
    behind = int(np.argmin(centers[:, 0]))
    assert hidden[behind, 1].mean() > 0.3
    assert not hidden[int(np.argmax(centers[:, 0])), 1].any()


def test_absent_person_hides_nothing():
    points = standing_people(0.0, 0.8)
    absent = np.full_like(points[:, :1], np.nan)
    assert not hidden_keypoints(RIG, points, bodies_of(absent, SKELETON)).any()


def test_capsules_are_concatenated_in_order():
    points = standing_people(0.0, 0.8)
    first, second = (bodies_of(points[:, p : p + 1], SKELETON) for p in range(2))
    joined = Capsules.concatenate([first, second])
    whole = bodies_of(points, SKELETON)
    np.testing.assert_array_equal(joined.starts_m, whole.starts_m)
    np.testing.assert_array_equal(joined.radii_m, whole.radii_m)
    assert set(whole.owners.tolist()) == {0, 1}
