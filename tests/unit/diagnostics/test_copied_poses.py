"""Cameras with the same calibrated pose."""

from dataclasses import replace

from posefuse.diagnostics.copied_poses import same_poses
from posefuse.model.cameras import CameraRig
from tests.scenes import ring


def with_pose_of(rig: CameraRig, copy: int, original: int, shift_m: float = 0.0) -> CameraRig:
    """Return the rig with the pose of one camera copied to another and shifted along its x axis."""
    pose = rig.cameras[original].camera_from_world.copy()
    pose[0, 3] += shift_m
    cameras = list(rig.cameras)
    cameras[copy] = replace(cameras[copy], camera_from_world=pose)
    return replace(rig, cameras=tuple(cameras))


def test_only_copied_poses_are_found():
    rig = ring(5)
    assert same_poses(rig) == []
    assert same_poses(with_pose_of(rig, 3, 1)) == [(1, 3)]
    assert same_poses(with_pose_of(with_pose_of(rig, 3, 1), 4, 1)) == [(1, 3), (1, 4), (3, 4)]


def test_close_cameras_with_one_orientation_are_not_copies():
    """The cameras of the ring are up to 10 m apart, so that the limit is 10 mm."""
    assert same_poses(with_pose_of(ring(5), 3, 1, shift_m=0.05)) == []
    assert same_poses(with_pose_of(ring(5), 3, 1, shift_m=0.001)) == [(1, 3)]
