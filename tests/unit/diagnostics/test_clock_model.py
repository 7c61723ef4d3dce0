"""Selection of the clock model from the offsets measured per block."""

import numpy as np
import pytest
from benchmarks.fault_scenes import healthy, plant

from posefuse.diagnostics.clock_model import fit_clock
from posefuse.diagnostics.linear_system import LinearSystem, NormalEquations
from posefuse.diagnostics.recording_model import N_PARAMETERS, Parameter
from posefuse.pipeline.diagnose import measure_sync

BLOCKS, PERIOD_S, SD_S = 30, 0.04, 0.01
SECONDS = np.arange(BLOCKS) + 0.5


def measured_system(offset_s: np.ndarray, current_offset_s: np.ndarray) -> LinearSystem:
    """Return a system of one view in which each block measures an offset with standard deviation SD_S."""
    place = Parameter.OFFSET
    normal, right = np.zeros((BLOCKS, N_PARAMETERS, N_PARAMETERS)), np.zeros((BLOCKS, N_PARAMETERS))
    normal[:, place, place] = SD_S**-2.0
    right[:, place] = (offset_s - current_offset_s) * SD_S**-2.0
    sums = NormalEquations(normal, right)
    return LinearSystem(sums, sums, np.arange(BLOCKS), SECONDS, np.array([100]), float(BLOCKS))


CLOCK_ERRORS = {
    "offset": np.full(BLOCKS, 0.05),
    "drift": 2e-3 * (SECONDS - SECONDS[0]),
    "dropped": np.where(SECONDS > 12.0, 3 * PERIOD_S, 0.0),
}


@pytest.mark.parametrize("kind", CLOCK_ERRORS)
@pytest.mark.parametrize("current_offset_s", [0.0, 0.03])
def test_clock_error_is_identified_from_any_start(rng, kind, current_offset_s):
    offset_s, current = CLOCK_ERRORS[kind] + SD_S * rng.normal(size=BLOCKS), np.full(BLOCKS, current_offset_s)
    fit = fit_clock(measured_system(offset_s, current), 0, current, PERIOD_S, 1.0)
    assert fit is not None
    assert fit.hypothesis.kind == kind
    assert np.abs(fit.offset_s - CLOCK_ERRORS[kind]).max() < 4.0 * SD_S


def test_half_a_frame_is_not_a_dropped_frame(rng):
    """A step of half a frame is no dropped frame: the clock has the mean offset."""
    offset_s = np.where(SECONDS > 15.0, 0.45 * PERIOD_S, 0.0) + 0.02
    fit = fit_clock(measured_system(offset_s, np.zeros(BLOCKS)), 0, np.zeros(BLOCKS), PERIOD_S, 1.0)
    assert fit is not None
    assert fit.hypothesis.kind != "dropped"


def test_offset_is_rarely_mistaken_for_a_drift():
    as_offset = []
    for seed in range(100):
        offset_s = 0.05 + SD_S * np.random.default_rng(seed).normal(size=BLOCKS)
        fit = fit_clock(measured_system(offset_s, np.zeros(BLOCKS)), 0, np.zeros(BLOCKS), PERIOD_S, 1.0)
        as_offset.append(fit is not None and fit.hypothesis.kind == "offset")
    assert sum(as_offset) >= 95


def test_no_fit_without_measurements():
    system = measured_system(np.zeros(BLOCKS), np.zeros(BLOCKS))
    unmeasured = LinearSystem(
        NormalEquations(0.0 * system.blocks.normal, system.blocks.right), *list(vars(system).values())[1:]
    )
    assert fit_clock(unmeasured, 0, np.zeros(BLOCKS), PERIOD_S, 1.0) is None


@pytest.mark.long
def test_offset_errors_match_their_standard_deviations():
    """Four views of a walk of 20 s, one late: errors about the mean divided by their standard deviations."""
    scores = []
    for seed in range(30):
        scene, _ = plant(
            healthy(seed, cameras=4, duration_s=20.0, rate_hz=25.0, activities=("walk",)), "late", (1,), 1.3
        )
        views, _ = measure_sync(*scene.watch())
        truth = np.array([0.0, 1.3, 0.0, 0.0]) / 25.0
        late = np.array([view.offset_s[0] for view in views])
        scores += list((late - late.mean() - truth + truth.mean()) / [view.offset_sd_s for view in views])
    scores = np.abs(scores)
    assert 0.55 < (scores < 1.0).mean() < 0.80
    assert 0.90 < (scores < 2.0).mean() < 0.99
