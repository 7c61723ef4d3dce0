"""Gait of a result: tables, events, contact in the file, and what is left out."""

import csv
import re
from dataclasses import replace

import numpy as np
import pytest

from posefuse.io.results import netcdf
from posefuse.io.results.netcdf_contact import read_contact
from posefuse.io.results.rounding import rounded
from posefuse.model.track_events import EVENT_KINDS
from posefuse.pipeline.gait import analyze_gait
from posefuse.pipeline.joint_angles import with_joint_angles
from posefuse.pipeline.write_outputs import write_outputs
from posefuse.progress import Silent
from posefuse.synthetic.gait_plans import WalkPlan, stand, walk
from posefuse.synthetic.gait_scenes import simulate_gait


@pytest.fixture(scope="module")
def result():
    return simulate_gait(walk(WalkPlan()), WalkPlan().duration_s).truth


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("gait")
    netcdf.write([result], folder / "reconstruction.nc")
    written = write_outputs(netcdf.read_reconstruction(folder / "reconstruction.nc"), folder, Silent())
    assert {"gait.csv", "cycles.csv", "events.csv"} <= set(written.files)
    assert "steps/min" in written.gait[0]
    return folder


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_tables_are_tidy(folder):
    rows = rows_of(folder / "gait.csv")
    assert list(rows[0]) == ["person", "parameter", "side", "value", "sd", "n", "low95", "high95", "layer"]
    cadence = next(row for row in rows if (row["parameter"], row["side"]) == ("cadence_steps_min", "both"))
    assert float(cadence["low95"]) < float(cadence["value"]) < float(cadence["high95"])
    cycles = rows_of(folder / "cycles.csv")
    assert {float(row["percent"]) for row in cycles} == set(range(101))
    assert all(float(row["low95"]) <= float(row["mean"]) <= float(row["high95"]) for row in cycles if row["low95"])


@pytest.mark.parametrize("strides", [3, 4])
def test_intervals_need_four_values_and_are_empty_otherwise(strides, tmp_path):
    plan = WalkPlan(strides=strides)
    result = simulate_gait(walk(plan), plan.duration_s).truth
    netcdf.write([result], tmp_path / "reconstruction.nc")
    write_outputs(netcdf.read_reconstruction(tmp_path / "reconstruction.nc"), tmp_path, Silent())
    for name in ("gait.csv", "cycles.csv"):
        rows = rows_of(tmp_path / name)
        assert min(int(float(row["n"])) for row in rows) < 4
        for row in rows:
            assert (row["low95"] != "") == (row["high95"] != "") == (int(float(row["n"])) >= 4)
            assert "inf" not in "".join((row["low95"], row["high95"], row["sd"]))


def test_numbers_of_the_summary_rest_on_the_same_strides(result):
    gait = analyze_gait(result)
    (line,) = gait.summary()
    found = re.fullmatch(
        r"person_1: (\d+) steps, (\d+) steps/min, ([\d.]+) m/s, ([\d.]+) m per stride \(from (\d+) strides\)", line
    )
    cadence, speed, length = (float(found[i]) for i in (2, 3, 4))
    assert speed == pytest.approx(cadence * length / 120.0, abs=0.02)
    columns = gait.tables()["gait.csv"]
    for name in ("cadence_steps_min", "speed_m_s", "stride_length_m", "stride_time_s"):
        assert columns["n"][(columns["parameter"] == name) & (columns["side"] == "both")].tolist() == [int(found[5])]


def test_a_person_without_strides_has_no_numbers_of_strides(result):
    gait = analyze_gait(result)
    (person,) = gait.people.values()
    without = replace(person, parameters=[])
    assert replace(gait, people={"person_1": without}).summary()[0].endswith(" steps")


def test_the_pelvis_turns_relative_to_the_path_and_not_to_the_world():
    """A walk around a circle passes every heading; the simulated pelvis turns by 4 degrees."""
    plan = WalkPlan(1.2, radius_m=1.5, strides=8)
    truth = simulate_gait(walk(plan), plan.duration_s).truth
    columns = analyze_gait(with_joint_angles(truth)).tables()["cycles.csv"]
    own = columns["signal"] == "pelvis_rotation_deg"
    assert set(columns["side"][own]) == {"left", "right"}
    assert np.abs(columns["mean"][own]).max() < 10.0
    assert columns["sd"][own].max() < 10.0


def test_events_have_the_columns_of_tracks(folder):
    rows = rows_of(folder / "events.csv")
    assert list(rows[0]) == ["frame", "time_s", "person", "what", "why"]
    assert {row["what"] for row in rows} == {"heel_strike", "toe_off"} <= set(EVENT_KINDS)
    assert [int(row["frame"]) for row in rows] == sorted(int(row["frame"]) for row in rows)


def test_contact_is_in_the_file(folder, result):
    contact = read_contact(folder / "reconstruction.nc")
    assert contact.shape == (result.n_frames, 1, 2, 2)
    truth = walk(WalkPlan()).contact(np.asarray(result.time_s))
    assert ((contact[:, 0] > 0.5) == truth).mean() > 0.9
    stored = netcdf.read_reconstruction(folder / "reconstruction.nc").layers["measured"]
    assert stored == rounded(result).layers["measured"]


def test_standing_writes_no_tables(tmp_path):
    result = simulate_gait(stand(3.0), 3.0).truth
    netcdf.write([result], tmp_path / "reconstruction.nc")
    written = write_outputs(netcdf.read_reconstruction(tmp_path / "reconstruction.nc"), tmp_path, Silent())
    assert not {"gait.csv", "cycles.csv", "events.csv"} & set(written.files)
    assert written.gait == ()


def test_results_without_a_world_have_no_gait(result):
    assert analyze_gait(replace(result, rig=replace(result.rig, up_axis=None))) is None
    assert analyze_gait(result.frames(0, 7)) is None
    assert analyze_gait(replace(result, time_s=np.full(result.n_frames, np.nan))) is None
    assert analyze_gait(result) is not None
