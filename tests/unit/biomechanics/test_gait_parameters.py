"""Parameters of gait rest on the same strides, whatever events are rejected."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.biomechanics.contact_times import Interval
from posefuse.biomechanics.foot_paths import SIDES, FootPaths
from posefuse.biomechanics.gait_events import GaitEvent
from posefuse.biomechanics.gait_parameters import gait_parameters, mean_of

STEP_S, STEP_M, STANCE_S = 0.55, 0.7, 0.68
RATE_HZ = 50.0
KINDS = ("heel_strike", "toe_off")


def walk(steps):
    """Return paths and events of a walk along x; each foot rests at the place of its strike until its next swing."""
    time_s = np.arange(0.0, (steps + 3) * STEP_S, 1.0 / RATE_HZ)
    feet = np.zeros((len(time_s), 2, 2, 3))
    events = []
    for i in range(steps):
        strike = 1.0 + i * STEP_S
        feet[time_s >= strike - 0.1, i % 2, :, 0] = i * STEP_M
        events += [
            GaitEvent("heel_strike", i % 2, strike, 0.01, 1.0, 0),
            GaitEvent("toe_off", i % 2, strike + STANCE_S, 0.01, 1.0, 0),
        ]
    hips = np.zeros((len(time_s), 2, 3))
    paths = FootPaths(time_s, feet, np.zeros_like(feet), hips, *np.zeros((2, len(time_s), 2)))
    return paths, sorted(events, key=lambda event: event.time_s)


def contacts_of(events):
    """Return contact of heel and toes from strike to toe-off."""
    found = [[[], []], [[], []]]
    for side, parts in enumerate(found):
        times = [[each.time_s for each in events if (each.kind, each.side) == (kind, side)] for kind in KINDS]
        spans = [Interval(start, end, 0.01, 0.01) for start, end in zip(*times, strict=True)]
        for part in parts:
            part += spans
    return found


def parameters_of(paths, events, contacts=None):
    return gait_parameters(paths, events, contacts or contacts_of(events), np.zeros(2))


def uncertain(events, kind, every):
    """Return events of which every n-th of a kind was found by one method only, 0.05 s late."""
    at = [i for i, event in enumerate(events) if event.kind == kind][::every]
    return [
        replace(event, confidence=0.5, time_s=event.time_s + 0.05) if i in at else event
        for i, event in enumerate(events)
    ]


@pytest.mark.parametrize("every", [3, 5, 100])
def test_rejected_strikes_do_not_lengthen_steps(every):
    paths, events = walk(16)
    found = parameters_of(paths, uncertain(events, "heel_strike", every))
    for name, true in (
        ("cadence_steps_min", 60.0 / STEP_S), ("speed_m_s", STEP_M / STEP_S), ("stride_length_m", 2.0 * STEP_M),
        ("step_time_s", STEP_S), ("step_length_m", STEP_M), ("stance_time_s", STANCE_S),
    ):  # fmt: skip
        assert mean_of(found, name).value == pytest.approx(true, rel=1e-6), name


@pytest.mark.parametrize("seed", range(5))
def test_speed_is_stride_length_times_cadence(seed):
    rng = np.random.default_rng(seed)
    paths, events = walk(14)
    events = [replace(event, time_s=event.time_s + rng.normal(0.0, 0.03)) for event in events]
    feet = paths.feet_m + np.cumsum(rng.normal(0.0, 0.02, (len(paths.time_s), 1, 1, 3)), axis=0)
    events = uncertain(sorted(events, key=lambda event: event.time_s), "heel_strike", 2 + seed)
    found = parameters_of(replace(paths, feet_m=feet), events)
    for side in (*SIDES, "both"):
        cadence, speed, length = (
            mean_of(found, name, side) for name in ("cadence_steps_min", "speed_m_s", "stride_length_m")
        )
        assert (cadence is None) == (speed is None) == (length is None)
        if speed is not None:
            assert speed.value == pytest.approx(length.value * cadence.value / 120.0)
            assert cadence.n == speed.n == length.n


def test_strides_without_a_place_count_for_nothing():
    paths, events = walk(12)
    hidden = replace(paths, feet_m=np.where(paths.time_s[:, None, None, None] < 2.4, np.nan, paths.feet_m))
    counts = {each.n for each in parameters_of(hidden, events) if each.name.startswith(("stride", "speed", "cadence"))}
    assert max(counts) < max(each.n for each in parameters_of(paths, events) if each.name == "speed_m_s")
    assert {mean_of(parameters_of(hidden, events), name).n for name in ("stride_time_s", "speed_m_s")} == {max(counts)}


def test_toe_offs_that_one_method_found_count_for_no_parameter():
    paths, events = walk(12)
    names = {each.name for each in parameters_of(paths, uncertain(events, "toe_off", 1))}
    assert not any(name.startswith(("stance", "swing", "double", "single", "flight")) for name in names)
    assert {"stride_time_s", "cadence_steps_min", "step_length_m"} <= names
    half = mean_of(parameters_of(paths, uncertain(events, "toe_off", 2)), "stance_time_s")
    assert half.n < mean_of(parameters_of(paths, events), "stance_time_s").n


def test_stances_that_contact_does_not_show_count_for_no_parameter():
    """Feet that slide in every step touch the ground only briefly."""
    paths, events = walk(12)
    brief = [
        [[Interval(each.start_s, each.start_s + 0.1, 0.01, 0.01) for each in part] for part in parts]
        for parts in contacts_of(events)
    ]
    names = {each.name for each in parameters_of(paths, events, brief)}
    assert not any(name.startswith(("stance", "swing", "double", "single", "flight")) for name in names)


@pytest.mark.parametrize("pause", [0.9, 2.0 * STEP_S])
def test_pauses_and_missed_steps_are_no_steps(pause):
    paths, events = walk(16)
    events = [event if event.time_s < 4.0 else replace(event, time_s=event.time_s + pause) for event in events]
    found = parameters_of(paths, events)
    assert mean_of(found, "cadence_steps_min").value == pytest.approx(60.0 / STEP_S)
    assert mean_of(found, "step_time_s").value == pytest.approx(STEP_S)


@pytest.mark.parametrize("seed", range(30))
def test_intervals_are_possible_and_rest_on_four_values(seed):
    rng = np.random.default_rng(seed)
    paths, events = walk(int(rng.integers(4, 14)))
    events = [
        replace(event, time_s=event.time_s + rng.uniform(-0.2, 0.2), confidence=rng.choice([0.5, 1.0], p=[0.2, 0.8]))
        for event in events
    ]
    feet = paths.feet_m + np.cumsum(rng.normal(0.0, 0.1, (len(paths.time_s), 1, 1, 3)), axis=0)
    events = sorted(events, key=lambda event: event.time_s)
    for each in parameters_of(replace(paths, feet_m=feet), events):
        assert np.isfinite(each.value)
        assert np.isfinite([each.low95, each.high95]).all() == (each.n >= 4), each
        if each.n < 4:
            continue
        assert each.low95 <= each.value <= each.high95
        least, most = (-200.0, 200.0) if "asymmetry" in each.name else (0.0, np.inf)
        most = 100.0 if each.name.endswith("_percent") and "asymmetry" not in each.name else most
        if each.value > 0.0 and each.name not in ("step_length_m", "step_width_m", "single_support_percent"):
            assert least <= each.low95 <= each.high95 <= most, each
