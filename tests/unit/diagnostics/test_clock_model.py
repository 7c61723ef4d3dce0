"""In which way a clock is wrong, from what each second measures of it."""

import numpy as np
import pytest

from posefuse.diagnostics.clock_model import fit_clock
from posefuse.diagnostics.linear_system import NormalEquations, LinearSystem
from posefuse.diagnostics.recording_model import N_PARAMETERS, Parameter
from posefuse.pipeline.diagnose import measure_sync
from posefuse.synthetic.faults import healthy, plant

BLOCKS, PERIOD_S, SD_S = 30, 0.04, 0.01
SECONDS = np.arange(BLOCKS) + 0.5


def measuring(offset_s: np.ndarray, granted_s: np.ndarray) -> LinearSystem:
    """A system of one view each block of which measures an offset to SD_S."""
    place = Parameter.OFFSET
    normal, right = np.zeros((BLOCKS, N_PARAMETERS, N_PARAMETERS)), np.zeros((BLOCKS, N_PARAMETERS))
    normal[:, place, place] = SD_S**-2.0
    right[:, place] = (offset_s - granted_s) * SD_S**-2.0
    sums = NormalEquations(normal, right)
    return LinearSystem(sums, sums, np.arange(BLOCKS), SECONDS, np.array([100]), float(BLOCKS))


LINES = {
    "late": np.full(BLOCKS, 0.05),
    "drift": 2e-3 * (SECONDS - SECONDS[0]),
    "dropped": np.where(SECONDS > 12.0, 3 * PERIOD_S, 0.0),
}


@pytest.mark.parametrize("kind", LINES)
@pytest.mark.parametrize("granted_s", [0.0, 0.03])
def test_the_line_through_what_was_measured_is_named_whatever_was_granted(rng, kind, granted_s):
    offset_s, granted = LINES[kind] + SD_S * rng.normal(size=BLOCKS), np.full(BLOCKS, granted_s)
    line = fit_clock(measuring(offset_s, granted), 0, granted, PERIOD_S, 1.0)
    assert line is not None
    assert line.hypothesis.kind == kind
    assert np.abs(line.offset_s - LINES[kind]).max() < 4.0 * SD_S


def test_half_a_frame_is_not_dropped(rng):
    """A step of half a frame is no frame that is lacking: the clock is late by what it is in the mean."""
    offset_s = np.where(SECONDS > 15.0, 0.45 * PERIOD_S, 0.0) + 0.02
    line = fit_clock(measuring(offset_s, np.zeros(BLOCKS)), 0, np.zeros(BLOCKS), PERIOD_S, 1.0)
    assert line is not None
    assert line.hypothesis.kind != "dropped"


def test_an_offset_is_hardly_ever_said_to_drift():
    named = []
    for seed in range(100):
        offset_s = 0.05 + SD_S * np.random.default_rng(seed).normal(size=BLOCKS)
        line = fit_clock(measuring(offset_s, np.zeros(BLOCKS)), 0, np.zeros(BLOCKS), PERIOD_S, 1.0)
        named.append(line is not None and line.hypothesis.kind == "late")
    assert sum(named) >= 95


def test_nothing_is_said_where_nothing_was_measured():
    system = measuring(np.zeros(BLOCKS), np.zeros(BLOCKS))
    nothing = LinearSystem(NormalEquations(0.0 * system.blocks.normal, system.blocks.right), *list(vars(system).values())[1:])
    assert fit_clock(nothing, 0, np.zeros(BLOCKS), PERIOD_S, 1.0) is None


@pytest.mark.long
def test_offsets_err_as_their_standard_deviations_say():
    """Of four views of a walk of 20 s, one late: errors about the mean over their standard deviations."""
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
