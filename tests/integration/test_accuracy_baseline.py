"""The gate on accuracy: as near to the oracle, and as honest about it, as the committed baseline."""

import json

from benchmarks.accuracy import BASELINE, measure, shortfalls


def test_accuracy_is_no_worse_than_the_baseline() -> None:
    assert shortfalls(measure(), json.loads(BASELINE.read_text())) == []


def test_gate_detects_a_loss_of_accuracy() -> None:
    baseline = json.loads(BASELINE.read_text())
    worse = {case: dict(figures, median_of_oracle=1.04) for case, figures in baseline.items()}
    lying = {case: dict(figures, covered_95=0.90) for case, figures in baseline.items()}
    assert len(shortfalls(worse, baseline)) == 2 * len(baseline)
    assert len(shortfalls(lying, baseline)) == 2 * len(baseline)
