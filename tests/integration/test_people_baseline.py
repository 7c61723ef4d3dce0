"""The gate on calibrations from people: as accurate as the committed baseline."""

import json

import pytest
from benchmarks import people_baseline
from benchmarks.people_baseline import BASELINE, FIGURES, measure, real, shortfalls, simulated


@pytest.mark.long
def test_simulated_rigs_are_as_accurate_as_the_baseline():
    measured = {name: measure(case, focal_known=known) for name, case, known in simulated()}
    assert shortfalls(measured, json.loads(BASELINE.read_text("utf-8"))) == []


@pytest.mark.long
def test_recordings_are_as_accurate_as_the_baseline(shared_data):
    folder = shared_data("pose2sim").parent
    shared_data("panoptic_motion")
    shared_data("mvor")
    measured = {name: measure(case, focal_known=known) for name, case, known in real(folder)}
    assert shortfalls(measured, json.loads(BASELINE.read_text("utf-8"))) == []


def test_gate_detects_a_loss_of_accuracy():
    baseline = json.loads(BASELINE.read_text("utf-8"))
    assert set(people_baseline.SIMULATED) < set(baseline)
    assert shortfalls(baseline, baseline) == []
    worse = {n: {k: 1.2 * v + 2.0 * FIGURES[k] for k, v in figures.items()} for n, figures in baseline.items()}
    assert len(shortfalls(worse, baseline)) == sum(len(figures) for figures in baseline.values())
