"""A real mouse without a kinematic tree, tracked as one of several people."""

import numpy as np
from benchmarks import real_recordings

import posefuse
from posefuse.kinematics.initial_pose import pose_from_points
from posefuse.model.tracks import TrackState
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.skeleton.trees import CONE, TWIST


def test_mouse_keeps_one_identity(shared_data):
    rig, detections = real_recordings.sleap_mouse(shared_data("sleap_mouse").parent)
    assert detections.skeleton.tree is None
    detections = detections if detections.rate_hz else detections.with_rate(60)
    result = posefuse.reconstruct(rig, detections, posefuse.Options(people="many"))
    assert result.person_ids == ("person_1",)
    assert result.tracks is not None
    active = np.asarray(result.tracks.state[:, 0]) == TrackState.ACTIVE
    # 7 frames are needed to believe in it.
    assert active[8:].all()
    model, measured = (np.asarray(result.layers[name].points_m[8:, 0]) for name in ("model", "measured"))
    apart = np.linalg.norm(model - measured, axis=-1)
    assert np.nanmedian(apart) < 0.003


def test_hand_labeled_mouse_joints_are_within_limits(shared_data):
    file = shared_data("dannce_mouse") / "label3d_demo.mat"
    detections = posefuse.read_detections(file).with_rate(30)
    result = posefuse.reconstruct(
        posefuse.read_cameras(file), detections, posefuse.Options(people="one", solve="frame")
    )
    tree = shipped_skeleton("mouse_22").tree
    assert tree is not None
    assert len(tree.limits) == 12
    whole = [points for points in np.asarray(result.layers["measured"].points_m[:, 0]) if np.isfinite(points).all()]
    assert len(whole) > 5
    for points in whole:
        _, turns, bones = pose_from_points(tree, points, np.asarray(tree.shape_m))
        for limit in tree.limits:
            axis = turns[limit.segment] @ np.array(limit.axis)
            if limit.kind == TWIST:
                other = axis @ turns[limit.bone] @ np.array(limit.axis)
            elif limit.kind == CONE:
                other = axis @ bones[limit.bone][:, 2]
            else:
                other = axis @ np.cross(bones[limit.before][:, 2], bones[limit.bone][:, 2])
            assert other > limit.least
