"""Contact, gait events, parameters, cycles and repetitions of motions with known contacts."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from posefuse.biomechanics.contact_times import foot_intervals
from posefuse.biomechanics.foot_paths import FootPaths, foot_paths, has_feet, level_axes
from posefuse.biomechanics.gait import analyze_person
from posefuse.biomechanics.gait_parameters import mean_of
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.figures import human
from posefuse.synthetic.gait_plans import WalkPlan, stand, walk
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.scenes import truth_of

SKELETON = find_skeleton("halpe_26")
NOISE_M = 0.001


def paths_of(motion, duration_s, rate_hz=60.0):
    time_s = np.arange(round(duration_s * rate_hz)) / rate_hz
    figure = human(1.75)
    points = motion.positions(figure, time_s)[:, figure.columns(SKELETON)]
    points = points + np.random.default_rng(0).normal(0.0, NOISE_M, points.shape)
    truth = truth_of(build_rig("ring", 2), SKELETON, points, rate_hz)
    return foot_paths([truth], "measured", (0.0, 0.0, 1.0))[0]


MOTIONS = {
    "walk": WalkPlan(),
    "limp": WalkPlan(1.1, 1.15, limp=0.05),
    "circle": WalkPlan(1.2, radius_m=1.5, strides=8),
    "run": WalkPlan(3.0, 0.72, 0.36),
    "upstairs": WalkPlan(0.5, 1.4, strides=4, stair_m=0.17),
    "treadmill": WalkPlan(treadmill=True),
}


@cache
def analyzed(name, rate_hz=60.0):
    plan = MOTIONS[name]
    motion = walk(plan)
    paths = paths_of(motion, plan.duration_s, rate_hz)
    return motion, paths, analyze_person(paths)


def f1(found, true):
    return 2 * (found & true).sum() / (found.sum() + true.sum())


def times(gait, kind, side):
    return np.array([event.time_s for event in gait.events if (event.kind, event.side) == (kind, side)])


class TestContact:
    @pytest.mark.parametrize("name", MOTIONS)
    def test_contact_of_heel_and_toes_is_found(self, name):
        motion, paths, gait = analyzed(name)
        assert f1(gait.contact.probability > 0.5, motion.contact(paths.time_s)) > 0.93

    @pytest.mark.parametrize("rate_hz", [30.0, 120.0])
    def test_contact_does_not_depend_on_the_frame_rate(self, rate_hz):
        motion, paths, gait = analyzed("walk", rate_hz)
        assert f1(gait.contact.probability > 0.5, motion.contact(paths.time_s)) > 0.92

    def test_a_sliding_foot_touches_but_does_not_rest(self):
        motion = stand(6.0, slides=((1.0, 0.5, 0.3), (2.5, 0.6, -0.3)))
        paths = paths_of(motion, 6.0)
        contact = analyze_person(paths).contact
        slides = motion.left.sliding(paths.time_s)
        fast = slides & (np.abs(np.gradient(paths.feet_m[:, 0, 0, 0], paths.time_s)) > 0.3)
        assert (contact.probability > 0.5).mean() > 0.98
        assert contact.sliding[fast, 0].min() > 0.5
        assert contact.sliding[:, 1].max() < 0.1

    def test_stairs_have_levels(self):
        _, _, gait = analyzed("upstairs")
        assert np.diff(gait.contact.model.levels.heights_m) == pytest.approx(0.17, abs=0.01)

    def test_a_raised_foot_does_not_touch(self):
        paths = paths_of(stand(6.0), 6.0)
        raised = paths.feet_m.copy()
        raised[120:300, 0, :, 2] += 0.3
        contact = analyze_person(replace(paths, feet_m=raised)).contact
        assert contact.probability[150:270, 0].max() < 0.5
        assert contact.probability[150:270, 1].min() > 0.5

    def test_missing_feet_have_no_contact(self):
        paths = paths_of(stand(3.0), 3.0)
        feet = paths.feet_m.copy()
        feet[60:90, 0] = np.nan
        contact = analyze_person(replace(paths, feet_m=feet)).contact
        assert np.isnan(contact.probability[60:90, 0]).all()
        assert np.isfinite(contact.probability[:, 1]).all()

    def test_a_treadmill_moves(self):
        _, _, gait = analyzed("treadmill")
        assert gait.contact.model.ground_m_s == pytest.approx([-1.3, 0.0], abs=0.03)
        assert not analyzed("walk")[2].contact.model.ground_m_s.any()

    def test_intervals_are_found_between_frames(self):
        time_s = np.arange(0.0, 1.0, 1.0 / 60.0)
        points = np.minimum(time_s - 0.507, 0.0)[:, None, None] * np.array([2.0, 0.0, -0.4])
        probability = np.repeat((time_s[:, None] > 0.53).astype(float), 2, axis=1)
        (span,) = foot_intervals(time_s, np.repeat(points, 2, axis=1), np.zeros(2), probability)[0]
        assert span.start_s == pytest.approx(0.507, abs=0.01)
        assert span.end_s == np.inf


class TestEvents:
    @pytest.mark.parametrize("name", [name for name in MOTIONS if name != "upstairs"])
    def test_events_are_within_a_frame(self, name):
        motion, paths, gait = analyzed(name)
        for side in (0, 1):
            foot = motion.feet[side]
            last = paths.time_s[-1]
            strikes = foot.start_s[(foot.start_s > 0.5) & (foot.start_s < last - 0.5)]
            offs = foot.end_s[(foot.end_s > 0.5) & (foot.end_s < last - 0.5)]
            for kind, true in (("heel_strike", strikes), ("toe_off", offs)):
                apart = np.abs(times(gait, kind, side)[:, None] - true).min(axis=0)
                assert np.quantile(apart, 0.8) < 1.6 / 60.0
                assert len(times(gait, kind, side)) <= len(true) + 2

    def test_agreement_is_high_in_a_regular_walk(self):
        _, _, gait = analyzed("walk")
        assert np.median([event.confidence for event in gait.events]) > 0.9

    @pytest.mark.parametrize("activity", ["stand", "reach", "sit", "jump"])
    def test_other_activities_are_no_gait(self, activity):
        motion = HumanMotion.random((activity,), np.random.default_rng(1))
        gait = analyze_person(paths_of(motion, 12.0))
        assert gait.events == []
        assert gait.cycles == []


class TestParameters:
    def test_a_walk_has_its_parameters(self):
        plan, (_, _, gait) = MOTIONS["walk"], analyzed("walk")
        stride_m = plan.speed_m_s * plan.stride_s
        cadence = mean_of(gait.parameters, "cadence_steps_min")
        assert cadence.value == pytest.approx(120.0 / plan.stride_s, rel=0.02)
        assert mean_of(gait.parameters, "step_width_m").value == pytest.approx(plan.width_m, abs=0.01)
        longest = max(each.value for each in gait.parameters if each.name == "stride_length_m")
        assert longest == pytest.approx(stride_m, abs=0.15)
        assert cadence.low95 < cadence.value < cadence.high95

    def test_a_treadmill_walk_has_the_length_of_its_strides_on_the_belt(self):
        plan, (_, _, gait) = MOTIONS["treadmill"], analyzed("treadmill")
        assert mean_of(gait.parameters, "stride_length_m").value == pytest.approx(1.3 * plan.stride_s, abs=0.02)
        assert mean_of(gait.parameters, "speed_m_s").value == pytest.approx(1.3, abs=0.02)
        assert mean_of(gait.parameters, "stance_percent").value == pytest.approx(62.0, abs=2.0)
        assert mean_of(gait.parameters, "double_support_percent").value == pytest.approx(24.0, abs=4.0)

    def test_running_has_flight_and_no_double_support(self):
        _, _, gait = analyzed("run")
        assert mean_of(gait.parameters, "double_support_percent").value == 0.0
        assert mean_of(gait.parameters, "flight_percent").value > 15.0

    def test_a_limp_is_asymmetric(self):
        _, _, gait = analyzed("limp")
        stance = {each.side: each.value for each in gait.parameters if each.name == "stance_percent"}
        assert stance["right"] - stance["left"] > 3.0

    def test_cycles_have_the_height_of_the_heel(self):
        _, paths, gait = analyzed("treadmill")
        heel = next(each for each in gait.cycles if (each.side, each.signal) == ("left", "heel_height_m"))
        assert heel.mean.max() == pytest.approx(np.nanmax(paths.feet_m[:, 0, 0, 2]) - 0.015, abs=0.02)
        assert np.abs(heel.mean[15:30]).max() < 0.01
        assert {each.signal for each in gait.cycles} == {"heel_height_m", "toe_height_m", "knee_flexion_deg"}


class TestRepetitions:
    def test_jumps_have_their_flight_time_and_height(self):
        gait = analyze_person(paths_of(stand(6.0, flights=((2.0, 0.4), (4.5, 0.5))), 6.0))
        assert [each.kind for each in gait.repetitions] == ["jump", "jump"]
        assert [each.duration_s for each in gait.repetitions] == pytest.approx([0.4, 0.5], abs=0.02)
        assert gait.repetitions[0].size_m == pytest.approx(9.81 * 0.4**2 / 8, abs=0.02)
        assert gait.events == []

    def test_smoothed_paths_do_not_lengthen_flights(self):
        paths = paths_of(stand(6.0, flights=((2.0, 0.3), (4.5, 0.5))), 6.0)
        smooth = replace(paths, feet_m=gaussian_filter1d(paths.feet_m, 3.0, axis=0))
        gait = analyze_person(smooth)
        assert [each.duration_s for each in gait.repetitions] == pytest.approx([0.3, 0.5], abs=0.06)

    def test_toes_that_are_high_at_the_strike_land_second(self):
        """Contact that includes toes from the strike of the heel on, as smooth paths show it, is corrected."""
        plan, motion = MOTIONS["walk"], walk(MOTIONS["walk"])
        paths = paths_of(motion, plan.duration_s)
        true = motion.contact(paths.time_s)[:, 0].astype(np.float64)
        early = np.maximum(true[:, 0], true[:, 1])
        found = foot_intervals(paths.time_s, paths.feet_m[:, 0], np.zeros(2), np.stack([true[:, 0], early], axis=1))
        strikes, flats = (np.array([each.start_s for each in part if each.start_s > 0]) for part in found)
        assert flats == pytest.approx(motion.left.flat_s[1:][: len(flats)], abs=0.03)
        assert (flats - strikes > 0.05).all()

    def test_squats_have_their_depth(self):
        gait = analyze_person(paths_of(stand(8.0, drops=((1.0, 1.5, 0.35), (4.0, 1.8, 0.4))), 8.0))
        assert [each.kind for each in gait.repetitions] == ["squat", "squat"]
        assert [each.size_m for each in gait.repetitions] == pytest.approx([0.34, 0.39], abs=0.02)

    def test_a_long_rest_below_is_sitting(self):
        gait = analyze_person(paths_of(stand(10.0, drops=((1.0, 6.0, 0.4),)), 10.0))
        assert [each.kind for each in gait.repetitions] == ["sit_to_stand"]

    def test_standing_has_no_parameters(self):
        gait = analyze_person(paths_of(stand(5.0), 5.0))
        assert (gait.parameters, gait.repetitions, gait.events) == ([], [], [])


@pytest.mark.parametrize("seed", range(30))
def test_any_paths_give_probabilities_and_no_warnings(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(8, 150))
    feet = np.cumsum(rng.normal(0.0, [0.0, 1e-3, 0.1, 1.0, 10.0][seed % 5], (n, 2, 2, 3)), axis=0)
    hips = np.cumsum(rng.normal(0.0, 0.01, (n, 2, 3)), axis=0) + np.array([0.0, 0.0, 0.9])
    feet[rng.random(n) < [0.0, 0.1, 0.5, 0.95, 1.0][seed % 4]] = np.nan
    hips[rng.random(n) < [0.0, 0.3, 1.0][seed % 3]] = np.nan
    sd = np.where(np.isfinite(feet), 0.02, np.nan)
    times = np.cumsum(rng.uniform(0.005, 0.05, n))
    gait = analyze_person(FootPaths(times, feet, sd, hips, *np.full((2, n, 2), np.nan)))
    probability = gait.contact.probability[np.isfinite(feet[..., 0])]
    assert ((probability >= 0.0) & (probability <= 1.0)).all()


def test_level_axes_turn_up_to_z():
    for up in np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.0, 0.8]]]):
        turn = level_axes(up)
        np.testing.assert_allclose(turn @ up, [0.0, 0.0, 1.0], atol=1e-12)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1.0)


def test_only_skeletons_with_heels_and_toes_have_feet():
    assert has_feet(SKELETON)
    assert not has_feet(find_skeleton("coco_17"))
    assert not has_feet(find_skeleton("mouse_22"))
