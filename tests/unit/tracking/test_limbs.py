"""Limbs that are far from where they are thought to be are found all the same."""

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse import Options
from posefuse.following import tracker_of, usual_noise
from posefuse.model.frames import Frame
from posefuse.model.tracks import TrackState
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from posefuse.tracking.posing import aim, bones_shown
from tests.unit.tracking.test_smoothing import SKELETON

LEG = ("right_knee", "right_ankle")


def test_bones_are_turned_to_where_they_are_shown(rng):
    frames = Rotation.random(3, rng=rng).as_matrix()
    before = frames.copy()
    shown = np.array([-0.4 * frames[0][:, 2], [0.0, 0.3, 0.4], [np.nan, 0.0, 0.0]])
    aim(frames, shown, range(3))
    np.testing.assert_allclose(frames[:2, :, 2], shown[:2] / np.linalg.norm(shown[:2], axis=1)[:, None], atol=1e-12)
    np.testing.assert_array_equal(frames[2], before[2])
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (3, 1, 1)), atol=1e-12)
    untouched = frames.copy()
    aim(frames, -shown, [])
    np.testing.assert_array_equal(frames, untouched)


def test_bones_go_from_joint_to_joint(rng):
    tree = SKELETON.tree
    assert tree is not None
    points = rng.normal(size=(len(SKELETON), 3))
    points[SKELETON.index("left_wrist")] = np.nan
    shown = bones_shown(tree, points)
    thigh = points[SKELETON.index("right_knee")] - points[SKELETON.index("right_hip")]
    np.testing.assert_allclose(shown[tree.bones.index("right_knee")], thigh)
    assert np.isnan(shown[tree.bones.index("left_wrist")]).all()


def test_a_leg_taken_to_point_the_other_way_comes_back():
    """From the wrong side small steps do not find it: the robust weights of what is so far off are next to nothing."""
    simulated = simulate_crowd(CrowdOptions(people=1, duration_s=2.0, seed=2))
    noise = usual_noise(simulated.rig, Options())
    tracker = tracker_of(simulated.rig, SKELETON, noise, Options())
    truth = np.asarray(simulated.truth.layers["measured"].points_m)[:, 0]
    leg = [SKELETON.index(name) for name in ("right_knee", "right_ankle")]
    tree = SKELETON.tree
    assert tree is not None
    off = np.full(len(truth), np.nan)
    for f in range(len(truth)):
        for person in tracker.update(Frame.of(simulated.detections, f)).people:
            if person.state == TrackState.ACTIVE:
                off[f] = np.linalg.norm(person.points_m[leg] - truth[f, leg], axis=-1).max()
        if f == 25:
            for bone in ("right_knee", "right_ankle"):
                tracker.state.bones[0, tree.bones.index(bone)] *= [1.0, -1.0, -1.0]
    assert off[26] > 0.5
    assert np.nanmax(off[38:]) < 0.25
