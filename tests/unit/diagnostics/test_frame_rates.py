"""Views with another frame rate than stated are named with both rates, and `sync` corrects them."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.fault_scenes import Scene

from posefuse.diagnostics.examine import examine
from posefuse.diagnostics.frame_rates import RATE_ERRORS, STANDARD_RATES_HZ, growth, possible_errors
from posefuse.diagnostics.registry import list_findings
from posefuse.diagnostics.time_offsets import time_views
from posefuse.model.findings import FindingKind
from posefuse.synthetic.options import DetectorOptions

from .conftest import observe


def at_rate(scene: Scene, view: int, rate_hz: float, start_s: float = 0.0) -> Scene:
    """Return the scene with a view that films at another rate than its timestamps state."""
    late = scene.late_s.copy()
    late[:, view] += start_s + np.arange(scene.n_frames) * (1.0 / rate_hz - 1.0 / scene.rate_hz)
    return replace(scene, late_s=late)


@pytest.mark.parametrize(("rate_hz", "start_s"), [(24.0, 0.4), (30.0, 0.0), (50.0, -0.3)])
def test_frame_rate_is_named_and_corrected(walk, rate_hz, start_s):
    scene = at_rate(walk, 2, rate_hz, start_s)
    examination = examine(observe(scene, DetectorOptions()))
    (finding,) = list_findings(examination)
    assert (finding.kind, finding.cameras) == (FindingKind.FRAME_RATE, ("cam_2",))
    assert f"about {rate_hz:.4g} instead of 25 Hz" in finding.sentence
    timings = time_views(examination)
    assert timings is not None
    (wrong,) = [timing for timing in timings if timing.is_corrected]
    assert wrong.drift_ppm[0] == pytest.approx(1e6 * (25.0 / rate_hz - 1.0), abs=1000.0)
    assert wrong.offset_s[0] == pytest.approx(start_s, abs=0.02)


def test_errors_of_all_pairs_of_rates_are_distinct():
    stated = 1.0 + np.array(RATE_ERRORS)
    assert len(stated) == 16
    assert np.diff(stated).min() > 0.01
    assert [1.0 / (1.0 - growth(error)) for error in RATE_ERRORS] == pytest.approx(stated.tolist())


@pytest.mark.parametrize("stated_hz", [24.0, 25.0, 29.97, 30.0, 59.94])
def test_only_rates_of_cameras_are_possible(stated_hz):
    true = sorted(stated_hz / (1.0 + error) for error in possible_errors(1.0 / stated_hz))
    others = [rate for rate in STANDARD_RATES_HZ if abs(rate / stated_hz - 1.0) > 0.01]
    assert true == pytest.approx(others, rel=0.005)
    assert possible_errors(1.0 / 77.0) == RATE_ERRORS
