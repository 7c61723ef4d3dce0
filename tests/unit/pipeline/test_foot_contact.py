"""Feet on the ground in the solved layer: they neither slide nor sink, and moving feet move on."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from posefuse.model.options.options import Options
from posefuse.pipeline.foot_contact import find_foot_contact
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from posefuse.synthetic.gait_plans import WalkPlan, stand, walk
from posefuse.synthetic.gait_scenes import GaitSceneOptions, simulate_gait

RATE_HZ = 60.0
PLANS = {
    "walk": (walk(WalkPlan(strides=3, start_m=(-2.0, 0.0))), WalkPlan(strides=3).duration_s),
    "treadmill": (walk(WalkPlan(strides=3, treadmill=True)), WalkPlan(strides=3).duration_s),
    "slides": (stand(4.0, slides=((1.0, 0.6, 0.3), (2.2, 0.6, -0.3))), 4.0),
}


@cache
def scene(name):
    motion, duration_s = PLANS[name]
    return simulate_gait(motion, duration_s, GaitSceneOptions(seed=3, rate_hz=RATE_HZ))


@cache
def heels(name, switch):
    """Left heel of the solved layer and in truth, shape (frame, 3)."""
    data = scene(name)
    result = reconstruct(data.rig, data.detections, Options(contact=switch, health="off"))
    column = data.truth.skeleton.index("left_heel")
    layers = (result.layers["solved"], next(iter(data.truth.layers.values())))
    return [np.asarray(layer.points_m)[:, 0, column] for layer in layers]


def speeds(points_m):
    return np.linalg.norm(points_m[2:] - points_m[:-2], axis=1) * RATE_HZ / 2.0


def test_feet_do_not_slide():
    (free, true), (held, _) = heels("walk", "off"), heels("walk", "on")
    rests = speeds(true) < 0.005
    assert np.quantile(speeds(held)[rests], 0.9) < 0.06
    assert np.quantile(speeds(held)[rests], 0.9) < 0.4 * np.quantile(speeds(free)[rests], 0.9)
    errors = [np.linalg.norm(points - true, axis=1).mean() for points in (free, held)]
    assert errors[1] < errors[0]


def test_feet_move_with_a_belt():
    held, true = heels("treadmill", "on")
    rests = np.abs(np.gradient(true[:, 0]) * RATE_HZ + 1.3) < 0.005
    assert rests.sum() > 30
    assert np.median(np.gradient(held[:, 0])[rests]) * RATE_HZ == pytest.approx(-1.3, abs=0.05)


def test_sliding_feet_are_not_frozen():
    held, true = heels("slides", "on")
    assert np.ptp(held[:, 0]) == pytest.approx(np.ptp(true[:, 0]), rel=0.25)


@pytest.mark.long
def test_feet_that_slide_in_every_step_are_left_alone():
    """The simulated walker's feet move at 0.3 m/s or more while they touch the floor."""
    data = simulate_crowd(CrowdOptions(people=1, duration_s=8.0, skeleton="coco_wholebody_133", seed=7))
    layers = [
        np.asarray(
            reconstruct(data.rig, data.detections, Options(contact=switch, health="off")).layers["solved"].points_m
        )
        for switch in ("off", "on")
    ]
    np.testing.assert_array_equal(*layers)


def test_contact_needs_feet_and_an_up_axis():
    data = scene("slides")
    layer = next(iter(data.truth.layers.values()))
    parts = [(np.asarray(data.truth.time_s), layer)]
    assert find_foot_contact(data.rig, data.truth.skeleton, parts) is not None
    assert find_foot_contact(replace(data.rig, up_axis=None), data.truth.skeleton, parts) is None
    assert find_foot_contact(data.rig, find_skeleton("coco_17"), parts) is None
