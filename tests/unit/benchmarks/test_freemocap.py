"""The comparison with FreeMoCap: stored figures, and FreeMoCap itself where its environments are installed."""

import json

import pytest
from benchmarks import freemocap
from benchmarks.speed import peer_environment

STORED = json.loads(freemocap.FIGURES.read_text("utf-8"))
NAMES = [case.name for case in freemocap.cases(2) if case.truth_m is not None]


@pytest.mark.parametrize("program", freemocap.PROGRAMS, ids=lambda program: program.method)
def test_stored_figures_cover_every_case(program):
    stored = STORED[program.method]
    assert set(NAMES) <= set(stored)
    for name in NAMES:
        # FreeMoCap keeps points behind a camera, and outliers of 300 px and more produce some.
        extreme = "300-1500" in name
        assert stored[name]["program"]["presence_percent"] <= (10.0 if extreme else 0.0)
        assert stored[name]["program"]["p99_mm"] < (2.0 if extreme else 0.01)
        assert extreme or stored[name]["program"]["max_mm"] < 0.05


@pytest.mark.long
@pytest.mark.parametrize("program", freemocap.PROGRAMS, ids=lambda program: program.method)
def test_points_equal_those_of_freemocap(program):
    if not peer_environment(program.peer).exists():
        pytest.skip(
            f"FreeMoCap is not installed: run python -m benchmarks.freemocap, which installs {program.peer} with uv"
        )
    case = next(case for case in freemocap.cases(freemocap.FRAMES) if case.name == NAMES[2])
    found = freemocap.compare(program, case)
    stored = STORED[program.method][case.name]
    assert found["program"]["presence_percent"] == 0.0
    assert found["program"]["max_mm"] < 0.001
    for key, value in stored["documentation"].items():
        assert found["documentation"][key] == pytest.approx(value, rel=1e-3, abs=1e-6), key
