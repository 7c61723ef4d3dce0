"""Simulated motion whose feet do not slide."""

import numpy as np
import pytest

from posefuse.synthetic.figures import human
from posefuse.synthetic.gait_plans import WalkPlan, stand, walk

RATE_HZ = 240.0
PLANS = {
    "walk": WalkPlan(),
    "slow": WalkPlan(0.6, 1.5, strides=4),
    "limp on a circle": WalkPlan(1.6, 0.95, strides=8, radius_m=2.0, limp=0.05),
    "run": WalkPlan(3.0, 0.72, 0.36),
    "upstairs": WalkPlan(0.5, 1.4, strides=4, stair_m=0.17),
    "downstairs": WalkPlan(0.5, 1.4, strides=4, stair_m=-0.17),
    "treadmill": WalkPlan(treadmill=True),
}
MOTIONS = {name: (walk(plan), plan.duration_s) for name, plan in PLANS.items()} | {
    "jumps": (stand(6.0, flights=((2.0, 0.4), (4.5, 0.5))), 6.0),
    "squats": (stand(6.0, drops=((1.0, 1.5, 0.35), (3.0, 1.5, 0.35))), 6.0),
    "slides": (stand(6.0, slides=((1.0, 0.5, 0.3), (2.5, 0.6, -0.3))), 6.0),
}


@pytest.fixture(scope="module", params=MOTIONS)
def motion(request):
    motion, duration_s = MOTIONS[request.param]
    figure, time_s = human(1.7), np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    return motion, figure, time_s, motion.positions(figure, time_s)


def test_bones_keep_their_length(motion):
    _, figure, _, points = motion
    lengths = np.linalg.norm(points[:, 1:] - points[:, np.array(figure.parents)[1:]], axis=-1)
    assert np.ptp(lengths, axis=0).max() < 1e-6


def test_touching_keypoints_move_with_the_ground_only(motion):
    plan, figure, time_s, points = motion
    ground = np.zeros((len(time_s), 3))
    ground[:, :2] = -plan.pelvis.at("belt_m", time_s)
    contact = plan.contact(time_s)
    for s, side in enumerate(("left", "right")):
        held = ~plan.feet[s].sliding(time_s)
        for part, node in enumerate(("heel", "big_toe")):
            on = contact[:, s, part] & held
            on = on[1:] & on[:-1]
            step = np.diff(points[:, figure.names.index(f"{side}_{node}")] - ground, axis=0)
            assert on.any()
            assert np.abs(step[on]).max() < 1e-6


def test_nothing_is_below_its_level_and_nothing_jumps(motion):
    plan, figure, _, points = motion
    speed = np.linalg.norm(np.diff(points[:, figure.names.index("mid_hip")], axis=0), axis=1) * RATE_HZ
    assert speed.max() < 5.0
    if not plan.pelvis.level_m.any():
        feet = [figure.names.index(f"{side}_{node}") for side in ("left", "right") for node in ("heel", "big_toe")]
        assert points[:, feet, 2].min() > 0.0145


def test_sliding_foot_touches_and_moves():
    motion, _ = MOTIONS["slides"]
    time_s = np.arange(0.0, 6.0, 1.0 / RATE_HZ)
    heel = motion.positions(human(), time_s)[:, human().names.index("left_heel")]
    slides = motion.left.sliding(time_s)
    assert motion.contact(time_s).all()
    assert np.ptp(heel[:, 0]) == pytest.approx(0.3, abs=1e-3)
    assert slides.sum() == pytest.approx(1.1 * RATE_HZ, abs=4)


def test_stride_is_speed_times_duration():
    plan = PLANS["walk"]
    places = walk(plan).right.place_m
    assert np.diff(places[2:-2, 0]) == pytest.approx(plan.speed_m_s * plan.stride_s, abs=1e-3)
