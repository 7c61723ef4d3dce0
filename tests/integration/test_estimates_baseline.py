"""The gate on estimates of people and animals: as accurate as the committed baseline."""

import json

import pytest
from benchmarks.estimates_baseline import BASELINE, CASES, TOLERATED, measure
from benchmarks.people_baseline import shortfalls


@pytest.mark.long
def test_estimates_are_as_accurate_as_the_baseline():
    assert shortfalls(measure(), json.loads(BASELINE.read_text("utf-8")), TOLERATED) == []


def test_gate_detects_a_loss_of_every_figure():
    baseline = json.loads(BASELINE.read_text("utf-8"))
    assert set(CASES) == set(baseline)
    assert shortfalls(baseline, baseline, TOLERATED) == []
    worse = {n: {k: 1.2 * v + 2.0 * TOLERATED[k] for k, v in figures.items()} for n, figures in baseline.items()}
    assert len(shortfalls(worse, baseline, TOLERATED)) == sum(len(figures) for figures in baseline.values())
