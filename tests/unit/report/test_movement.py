"""Joint angles, gait cycles, contact and gait parameters in the report and in figures."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from posefuse.biomechanics.cycles import gait_cycles
from posefuse.biomechanics.floor_levels import Levels
from posefuse.biomechanics.foot_paths import SIDES, FootPaths
from posefuse.biomechanics.gait_events import GaitEvent
from posefuse.biomechanics.gait_parameters import GaitParameter
from posefuse.model.joint_angles import OPENSIM
from posefuse.pipeline.gait import analyze_gait
from posefuse.pipeline.joint_angles import with_joint_angles
from posefuse.report.html import render_report
from posefuse.report.movement import movement_data, movement_section, shown_signals, signal_title
from posefuse.report.plots.data import gather_plot_data
from posefuse.report.plots.registry import draw_plot
from posefuse.report.series import gather_series
from posefuse.synthetic.gait_plans import WalkPlan, stand, walk
from posefuse.synthetic.gait_scenes import simulate_gait


@pytest.fixture(scope="module")
def result():
    return with_joint_angles(simulate_gait(walk(WalkPlan()), WalkPlan().duration_s).truth)


@pytest.fixture(scope="module")
def gait(result):
    return analyze_gait(result).people


@pytest.fixture(scope="module")
def data(result, gait):
    return movement_data(result, gait, gather_series(result.chunks(), "measured", result.skeleton))


def test_both_sides_of_every_angle_are_shown(result, data):
    shown = {panel["title"]: panel for panel in data["angles"]}
    angles = result.joint_angles
    known = np.isfinite(np.asarray(angles.degrees)).any(axis=(0, 1))
    for name, (left, right) in angles.sides(OPENSIM).items():
        panel = shown.pop(name.replace("_", " "), None)
        assert (panel is not None) == (known[left] or known[right])
        for side, i in (("left", left), ("right", right)):
            if panel and left != right:
                expected = np.asarray(angles.degrees[:, 0, i], dtype=np.float64)
                np.testing.assert_allclose(np.array(panel[side]["mean"][0], dtype=float), expected, atol=0.051)
    assert not shown


def test_contact_bars_are_the_intervals(gait, data, result):
    assert [row["label"] for row in data["contact"]] == ["left heel", "left toes", "right heel", "right toes"]
    (own,) = gait.values()
    for row, spans in zip(data["contact"], [part for side in own.intervals for part in side], strict=True):
        assert len(row["spans"]) == len(spans)
        times = np.array(row["spans"])
        assert (result.time_s[0] - 1e-3 <= times).all()
        assert (times <= result.time_s[-1] + 1e-3).all()


def test_table_has_both_sides_and_intervals(result, gait):
    text = movement_section(result, gait)
    row = re.search(r"<th>step length, m</th>(.*?)</tr>", text)
    cells = re.findall(
        r"<td>([\d.]+)&nbsp;&plusmn;&nbsp;([\d.]+) \(([\d.]+)&nbsp;to&nbsp;([\d.]+)\), n&nbsp;=&nbsp;(\d+)</td>", row[1]
    )
    (own,) = gait.values()
    assert [int(n) for *_, n in cells] == [each.n for each in own.parameters if each.name == "step_length_m"]
    assert all(float(low) <= float(value) <= float(high) for value, _, low, high, _ in cells)


def test_cells_of_few_values_have_a_number_and_no_interval(result, gait):
    (own,) = gait.values()
    few = GaitParameter("jump_height_m", "both", 0.25, 0.01, 3, np.nan, np.nan)
    single = GaitParameter("squat_depth_m", "both", 0.25, np.nan, 1, np.nan, np.nan)
    text = movement_section(result, {"person_1": replace(own, parameters=[few, single])})
    assert "<td>0.25&nbsp;&plusmn;&nbsp;0.01, n&nbsp;=&nbsp;3</td>" in text
    assert "<td>0.25, n&nbsp;=&nbsp;1</td>" in text
    assert "nan" not in text


def test_angles_that_pass_half_a_turn_have_circular_means(result):
    """Frames at 179 and -179 degrees have a mean of 180."""
    turned = np.asarray(result.joint_angles.degrees).copy()
    turned[...] = np.where(np.arange(len(turned)) % 2, 179.0, -179.0)[:, None, None]
    coarse = SimpleNamespace(interval_starts=lambda: np.arange(0, len(turned), 2))
    angles = replace(result.joint_angles, degrees=turned)
    for panel in movement_data(replace(result, joint_angles=angles), {}, coarse)["angles"]:
        sides = [panel[side]["mean"][0] for side in ("both", *SIDES) if side in panel]
        assert np.abs(np.array(sides, dtype=float)).min() == pytest.approx(180.0)


def test_number_of_cycles_is_stated_without_a_script(result, gait, data):
    (own,) = gait.values()
    signal = shown_signals(own.cycles)[0]
    left, right = (next(int(c.n.max()) for c in own.cycles if (c.signal, c.side) == (signal, side)) for side in SIDES)
    assert f'<span id="cycle-numbers">{left} left, {right} right</span>' in movement_section(result, gait)
    assert data["cycles"][0]["numbers"] == f"{left} left, {right} right"


def test_standing_has_angles_but_no_cycles():
    result = with_joint_angles(simulate_gait(stand(2.0), 2.0).truth)
    gait = analyze_gait(result).people
    text = movement_section(result, gait)
    assert "Joint angles" in text
    assert "Gait cycles" not in text
    assert "Gait and repetitions" not in text
    assert draw_plot("gait", gather_plot_data(result, None, gait=gait)) is None


def test_result_without_feet_and_angles_has_no_section(result):
    assert movement_section(replace(result, joint_angles=None), {}) == ""
    assert movement_data(replace(result, joint_angles=None), {}, None) is None


def test_names_are_escaped(result, gait):
    (own,) = gait.values()
    hostile = "<script>alert(1)</script>"
    named = replace(result, person_ids=(hostile,))
    page = render_report(named, gait={hostile: own, "other": own})
    assert hostile not in page


def test_figures_are_drawn(result, gait):
    for name in ("angles", "gait"):
        drawn = draw_plot(name, gather_plot_data(result, None, gait=gait))
        assert drawn.png.startswith(b"\x89PNG")
        assert drawn == draw_plot(name, gather_plot_data(result, None, gait=gait))


def test_angles_are_averaged_from_strike_to_strike():
    """A sine with one period per stride has the same course in every cycle."""
    time_s = np.arange(0.0, 5.0, 0.01)
    shape = (len(time_s), 2, 2, 3)
    paths = FootPaths(
        time_s, np.zeros(shape), np.zeros(shape), np.zeros((len(time_s), 2, 3)), *np.zeros((2, len(time_s), 2))
    )
    events = [
        GaitEvent(kind="heel_strike", side=0, time_s=time, sd_s=0.01, confidence=1.0, bout=0)
        for time in (0.5, 1.5, 2.5, 3.5)
    ]
    angle = np.stack([np.sin(2.0 * np.pi * (time_s - 0.5)), np.cos(time_s)], axis=1)
    cycles = gait_cycles(paths, events, Levels.none(), {"hip_flexion": angle}, np.zeros(2))
    (found,) = (each for each in cycles if each.signal == "hip_flexion_deg")
    assert (found.side, found.n.min()) == (SIDES[0], 3)
    np.testing.assert_allclose(found.mean, np.sin(2.0 * np.pi * np.arange(101) / 100.0), atol=1e-3)
    assert found.sd.max() < 1e-3
    assert shown_signals(cycles) == ("hip_flexion_deg",)


@pytest.mark.parametrize(
    ("name", "title"),
    [
        ("hip_flexion_deg", "hip flexion, degrees"),
        ("cadence_steps_min", "cadence, steps/min"),
        ("speed_m_s", "speed, m/s"),
        ("step_time_s", "step time, s"),
        ("stance_percent", "stance, %"),
    ],
)
def test_titles_have_units(name, title):
    assert signal_title(name) == title
