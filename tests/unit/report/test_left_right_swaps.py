"""The report section on left/right swaps."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.model.label_swaps import Swaps, SwapState
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.report.html import render_report
from posefuse.report.left_right_swaps import swap_section, swap_timeline
from posefuse.report.summary import summarize
from tests.scenes import body_points, ring, simulate_detections

CHAINS = ("arm", "leg")


@pytest.fixture
def result(rng):
    """Ten frames: legs are swapped in the second view from the sixth frame on, and the third view is undecided."""
    rig = ring(3)
    state = np.full((10, 1, 3, 2), SwapState.AS_LABELED, dtype=np.int8)
    state[5:, 0, 1, 1] = SwapState.SWAPPED
    state[:, 0, 2] = SwapState.UNKNOWN
    return replace(
        reconstruct(rig, simulate_detections(rig, body_points(rng, 10), rng, rate_hz=10.0)), swaps=Swaps(CHAINS, state)
    )


def test_shares_ignore_undecided_frames(result):
    summary = summarize(result.chunks(3), "measured")
    np.testing.assert_array_equal(summary.swapped, [[0.0, 0.0], [0.0, 0.5], [np.nan, np.nan]])
    assert summary.swapped_share(1) == 0.25
    assert np.isnan(summary.swapped_share(2))
    table = swap_section(result, summary)
    assert "<td>50.0 %</td>" in table
    assert table.count("<td>–</td>") == 2


@pytest.mark.parametrize("size", [1, 4, 10])
def test_timeline_has_one_row_per_camera_and_limb(size, result):
    line = swap_timeline(result.chunks(size), 10)
    assert line is not None
    assert line["rows"] == [f"{camera} {chain}" for camera in result.rig.names for chain in CHAINS]
    assert (line["time"], line["unit"]) == ([round(0.1 * i, 3) for i in range(10)], "s")
    assert line["share"][3] == [0.0] * 5 + [1.0] * 5
    assert line["share"][4] == [None] * 10


def test_long_recordings_are_shown_in_intervals(result, monkeypatch):
    monkeypatch.setattr("posefuse.report.left_right_swaps._MAX_INTERVALS", 5)
    monkeypatch.setattr("posefuse.report.left_right_swaps._MAX_ROWS", 3)
    line = swap_timeline(result.chunks(4), 10)
    assert line is not None
    assert line["rows"] == list(result.rig.names)
    assert line["share"][1] == [0.0, 0.0, 0.25, 0.5, 0.5]


def test_unknown_times_are_replaced_by_frame_numbers(result):
    line = swap_timeline(replace(result, time_s=np.where(np.arange(10) == 3, np.nan, result.time_s)).chunks(4), 10)
    assert line is not None
    assert (line["time"], line["unit"]) == (list(range(10)), "frame")


def test_section_is_empty_if_swaps_were_not_examined(result):
    unexamined = replace(result, swaps=None)
    assert swap_timeline(unexamined.chunks(), 10) is None
    assert "Left/right swaps" not in render_report(unexamined)
    assert "Left/right swaps" in render_report(result)
