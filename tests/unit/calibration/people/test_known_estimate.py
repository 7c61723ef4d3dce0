"""Calibrations by people with known poses: kept cameras are found, and their poses are the prior."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.calibration.people.known_cameras import KnownGroup, kept_cameras, pose_difference, posed, similarity
from posefuse.calibration.people.known_estimate import estimate_with_known
from posefuse.model.cameras import CameraRig, rotation_from_vector
from tests.unit.calibration.people.matched_scenes import disturbed, walking_person

SD = np.radians(0.05), 0.003


def turned(camera, angle_deg, shift_m=0.0):
    rotation = rotation_from_vector(np.radians(angle_deg) * np.array([0.0, 1.0, 0.0])) @ camera.rotation
    return posed(camera, rotation, camera.center_m + shift_m)


def other_world(rig, scale):
    rotation, shift = rotation_from_vector(np.array([0.3, -0.8, 1.1])), np.array([1.0, -2.0, 0.5])
    return [posed(c, c.rotation @ rotation.T, scale * rotation @ c.center_m + shift) for c in rig.cameras]


def test_a_similarity_is_found_from_two_cameras():
    _, rig = walking_person(cameras=4)
    found = other_world(rig, 0.4)
    world = similarity(found[:2], rig.cameras[:2])
    assert world.scale == pytest.approx(2.5)
    for camera, true in zip(found, rig.cameras, strict=True):
        assert np.allclose(world.camera(camera).camera_from_world, true.camera_from_world, atol=1e-9)


@pytest.mark.parametrize("moved", [(), (0,), (1, 3)])
def test_the_largest_group_that_kept_its_poses_is_found(moved):
    _, rig = walking_person(cameras=5)
    found = {c.name: c for c in other_world(rig, 0.4)}
    for v in moved:
        found[f"cam_{v}"] = turned(found[f"cam_{v}"], 10.0 + v, 0.2)
    limits = dict.fromkeys(found, (np.radians(1.0), 0.05))
    kept = kept_cameras(found, KnownGroup(rig, SD), limits)
    assert kept == tuple(name for v, name in enumerate(rig.names) if v not in moved)


def test_nothing_is_kept_of_another_rig():
    _, rig = walking_person(cameras=3)
    found = {c.name: turned(c, 20.0 * v, 0.5 * v) for v, c in enumerate(rig.cameras)}
    assert kept_cameras(found, KnownGroup(rig, SD), dict.fromkeys(found, (np.radians(1.0), 0.05))) == ()


@pytest.mark.parametrize("angle_deg", [0.0, 12.0])
def test_known_poses_are_better_than_people_alone(angle_deg):
    matched, rig = walking_person(cameras=3, duration_s=4.0, seed=2)
    known = replace(rig, cameras=(*rig.cameras[:2], turned(rig.cameras[2], angle_deg)))
    found = estimate_with_known(disturbed(matched, 2), (KnownGroup(known, SD),))
    assert found.moved == (() if angle_deg == 0.0 else ("cam_2",))
    errors = [np.degrees(pose_difference(a, b)[0]) for a, b in zip(_aligned(found, rig), rig.cameras, strict=True)]
    assert max(errors[:2]) < 0.15
    assert errors[2] < (0.15 if angle_deg == 0.0 else 2.5)
    # The known poses determine the scale, which people alone do not.
    apart = [np.linalg.norm(a.center_m - b.center_m) for a, b in (found.estimate.cameras[:2], rig.cameras[:2])]
    assert apart[0] == pytest.approx(apart[1], rel=0.002)


def _aligned(found, rig):
    names = list(found.kept)
    now = CameraRig(found.estimate.cameras)
    world = similarity([now[n] for n in names], [rig[n] for n in names], scale=1.0)
    return [world.camera(camera) for camera in now.cameras]


def test_known_cameras_that_people_do_not_show_are_added():
    matched, rig = walking_person(cameras=4, duration_s=4.0, seed=2)
    shown = replace(matched, views=matched.views[:3], offset_s=matched.offset_s[:3], rate=matched.rate[:3])
    found = estimate_with_known(disturbed(shown, 2), (KnownGroup(rig, SD),), add_unseen=True)
    assert found.kept == rig.names[:3]
    added = CameraRig(found.estimate.cameras)["cam_3"]
    apart = np.linalg.norm(added.center_m - found.estimate.cameras[0].center_m)
    assert apart == pytest.approx(np.linalg.norm(rig["cam_3"].center_m - rig["cam_0"].center_m), rel=0.002)
