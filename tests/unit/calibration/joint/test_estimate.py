"""Intervals of the joint estimate contain the truth as often as they should."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.clock_coverage import DURATIONS_S, PEOPLE, bounds, compare, coverage, run, simulate

from posefuse.calibration.joint import estimate as module
from posefuse.calibration.joint.equations import linearize
from posefuse.calibration.joint.estimate import estimate


def test_intervals_of_short_recordings_contain_the_truth():
    """Coverage is 95 % in 1,000 trials; bounds of four standard errors for 20 trials of correlated values."""
    trials = [run(person, 1.5, seed) for person in PEOPLE for seed in range(5)]
    for k in (0, 1):
        assert 0.86 <= coverage([trial.errors[k] for trial in trials]) <= 0.99
    assert coverage([trial.errors[2] for trial in trials if trial.errors[2]]) >= 0.86
    assert all(not trial.errors[2] for trial in trials[5:10]), "a standing person does not show the time"
    assert all(not trial.errors[3] for trial in trials), "1.5 s do not show a drift"


@pytest.mark.long
def test_intervals_contain_the_truth():
    trials = [run(person, duration_s, seed) for person in PEOPLE for duration_s in DURATIONS_S for seed in range(63)]
    for k in range(4):
        assert 0.93 <= coverage([trial.errors[k] for trial in trials if trial.errors[k]]) <= 0.97


def test_clocks_are_not_more_certain_than_the_bound():
    """The bound is that of an oracle; a person who stands still shows nothing to any estimator."""
    assert bounds("stands", 1.5, 0) == (np.inf, np.inf)
    joint = estimate(simulate("walks", 5.0, np.random.default_rng([0, 77]))[0])
    assert joint is not None
    offset_ms, drift_ppm = bounds("walks", 5.0, 0)
    assert offset_ms < 1e3 * joint.sd[:, 6].min() < 5.0 * offset_ms
    assert drift_ppm < 1e6 * joint.sd[:, 7].min()


def test_planted_offset_is_recovered():
    recording, truth = simulate("walks", 6.0, np.random.default_rng(9))
    times = recording.time_s.copy()
    times[:, 1] -= 0.1
    truth[1, 6] = 0.1
    joint = estimate(replace(recording, time_s=times))
    assert joint is not None
    assert np.abs(compare(joint, truth).errors[2]).max() < 4.0
    relative = joint.change[1, 6] - np.delete(joint.change[:, 6], 1).mean()
    assert relative == pytest.approx(0.1, abs=0.02)


def test_recording_without_shared_points_has_no_estimate(stand):
    xy = stand[0].xy.copy()
    xy[:, 1:] = np.nan
    assert estimate(replace(stand[0], xy=xy)) is None


def test_estimate_of_a_minute_converges(monkeypatch):
    """Clocks are then known to a fiftieth of a frame, and observations must not jump between frames."""
    recording, _ = simulate("walks", 60.0, np.random.default_rng([5, 77]))
    steps = []
    monkeypatch.setattr(module, "linearize", lambda *of: steps.append(of) or linearize(*of))
    assert estimate(recording) is not None
    assert len(steps) <= 12
