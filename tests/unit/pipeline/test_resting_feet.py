"""Feet of fitted bodies neither slide nor sink while they are in contact, and their legs keep their lengths."""

from functools import cache

import numpy as np
import pytest

from posefuse.model.options.options import Options
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.pipeline.resting_feet import _move_m
from posefuse.synthetic.gait_plans import WalkPlan, walk
from posefuse.synthetic.gait_scenes import GaitSceneOptions, simulate_gait
from posefuse.trajectory.ground_contact import GroundContact

PLAN, RATE_HZ = WalkPlan(strides=3, start_m=(-2.0, 0.0)), 60.0
SCENE = simulate_gait(walk(PLAN), PLAN.duration_s, GaitSceneOptions(seed=3, rate_hz=RATE_HZ))
KEYPOINTS = SCENE.truth.skeleton.keypoints
TRUE_M = np.asarray(next(iter(SCENE.truth.layers.values())).points_m)[:, 0]


@cache
def result(contact):
    return reconstruct(SCENE.rig, SCENE.detections, Options(contact=contact, health="off", bodies="fit"))


def path(contact, name):
    return np.asarray(result(contact).layers["model"].points_m)[:, 0, KEYPOINTS.index(name)]


def speeds(points_m):
    return np.linalg.norm(points_m[2:] - points_m[:-2], axis=1) * RATE_HZ / 2.0


@pytest.mark.parametrize("name", ["left_heel", "right_heel", "left_big_toe", "right_big_toe"])
def test_resting_feet_do_not_slide(name):
    true = TRUE_M[:, KEYPOINTS.index(name)]
    rests = speeds(true) < 0.005
    slides = {contact: np.nanquantile(speeds(path(contact, name))[rests], 0.9) for contact in ("on", "off")}
    assert slides["on"] < 0.06
    assert slides["on"] < 0.5 * slides["off"]
    errors = {contact: np.nanmean(np.linalg.norm(path(contact, name) - true, axis=1)) for contact in ("on", "off")}
    assert errors["on"] < errors["off"]


@pytest.mark.parametrize(("near", "far"), [("hip", "knee"), ("knee", "ankle"), ("ankle", "heel"), ("heel", "big_toe")])
def test_legs_keep_their_lengths(near, far):
    lengths = {
        contact: np.linalg.norm(path(contact, f"left_{far}") - path(contact, f"left_{near}"), axis=1)
        for contact in ("on", "off")
    }
    assert lengths["on"] == pytest.approx(lengths["off"], abs=1e-9, nan_ok=True)


def test_poses_are_those_of_the_points():
    poses = result("on").poses
    for joint, near in (("knee", "hip"), ("ankle", "knee")):
        bone = path("on", f"left_{joint}") - path("on", f"left_{near}")
        direction = np.asarray(poses.directions)[:, 0, poses.bones.index(f"left_{joint}")]
        known = np.isfinite(bone).all(axis=1)
        unit = bone[known] / np.linalg.norm(bone[known], axis=1, keepdims=True)
        assert unit == pytest.approx(direction[known], abs=1e-6)
    turns = np.asarray(poses.turns)[:, 0, poses.segments.index("left_foot")]
    arm = path("on", "left_heel") - path("on", "left_ankle")
    inside = np.einsum("fji,fj->fi", turns, arm)
    assert np.nanstd(inside, axis=0) == pytest.approx(np.zeros(3), abs=1e-6)


def test_errors_are_those_of_the_moved_points():
    found = result("on")
    layer = found.layers["model"]
    rows = found.tracks.rows(SCENE.detections)[:, 0]
    ankle = KEYPOINTS.index("left_ankle")
    for view, camera in enumerate(SCENE.rig.cameras):
        seen = np.flatnonzero(rows[:, view] >= 0)
        pixels = np.asarray(SCENE.detections.keypoints_px)[rows[seen, view], ankle]
        own = np.linalg.norm(camera.project(np.asarray(layer.points_m)[seen, 0, ankle])[0] - pixels, axis=1)
        assert np.asarray(layer.view_error_px)[seen, 0, ankle, view] == pytest.approx(own, rel=1e-4, nan_ok=True)


def test_a_foot_that_slides_far_does_not_rest():
    """Contact that contradicts the views by many standard deviations moves points by no more than errors explain."""
    time_s, sd_m = np.arange(120) / RATE_HZ, 0.01
    sliding = np.zeros((120, 3))
    sliding[:, 0] = 1.2 * time_s
    keypoint = KEYPOINTS.index("left_heel")
    ones, up = np.ones((1, 120)), np.array([0.0, 0.0, 1.0])
    contact = GroundContact((keypoint,), ones, ones, np.zeros(3), up, 0.0 * ones, 0.01)
    moves, _ = _move_m(contact, 0, time_s, sliding, sd_m)
    assert 0.5 * sd_m < np.linalg.norm(moves, axis=1).max() <= 2.5 * sd_m * (1.0 + 1e-9)


def test_the_upper_body_stays():
    assert np.array_equal(path("on", "left_wrist"), path("off", "left_wrist"), equal_nan=True)
    assert np.array_equal(path("on", "left_hip"), path("off", "left_hip"), equal_nan=True)
