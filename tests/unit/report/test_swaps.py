"""What the report shows of left and right."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.model.label_swaps import Swaps, SwapState
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.report.html import render_report
from posefuse.report.summary import summarise
from posefuse.report.swaps import swap_table, time_line
from tests.scenes import body_points, ring, seen

CHAINS = ("arm", "leg")


@pytest.fixture
def result(rng):
    """Ten frames; in the second view the legs are swapped from the fifth frame on, and the third never tells."""
    rig = ring(3)
    state = np.full((10, 1, 3, 2), SwapState.AS_LABELLED, dtype=np.int8)
    state[5:, 0, 1, 1] = SwapState.SWAPPED
    state[:, 0, 2] = SwapState.UNKNOWN
    return replace(reconstruct(rig, seen(rig, body_points(rng, 10), rng, rate_hz=10.0)), swaps=Swaps(CHAINS, state))


def test_shares_are_of_the_time_that_tells(result):
    summary = summarise(result.chunks(3), "measured")
    np.testing.assert_array_equal(summary.swapped, [[0.0, 0.0], [0.0, 0.5], [np.nan, np.nan]])
    assert summary.swapped_in(1) == 0.25
    assert np.isnan(summary.swapped_in(2))
    table = swap_table(result, summary)
    assert "<td>50.0 %</td>" in table
    assert table.count("<td>–</td>") == 2


@pytest.mark.parametrize("size", [1, 4, 10])
def test_the_time_line_has_a_row_a_camera_and_limb(size, result):
    line = time_line(result.chunks(size), 10)
    assert line is not None
    assert line["rows"] == [f"{camera} {chain}" for camera in result.rig.names for chain in CHAINS]
    assert (line["time"], line["unit"]) == ([round(0.1 * i, 3) for i in range(10)], "s")
    assert line["share"][3] == [0.0] * 5 + [1.0] * 5
    assert line["share"][4] == [None] * 10


def test_long_recordings_are_shown_in_stretches(result, monkeypatch):
    monkeypatch.setattr("posefuse.report.swaps._COLUMNS", 5)
    monkeypatch.setattr("posefuse.report.swaps._MOST_ROWS", 3)
    line = time_line(result.chunks(4), 10)
    assert line is not None
    assert line["rows"] == list(result.rig.names)
    assert line["share"][1] == [0.0, 0.0, 0.25, 0.5, 0.5]


def test_where_a_time_is_unknown_frames_are_counted(result):
    line = time_line(replace(result, time_s=np.where(np.arange(10) == 3, np.nan, result.time_s)).chunks(4), 10)
    assert line is not None
    assert (line["time"], line["unit"]) == (list(range(10)), "frame")


def test_where_labels_were_believed_nothing_is_said(result):
    believed = replace(result, swaps=None)
    assert time_line(believed.chunks(), 10) is None
    assert "Left and right" not in render_report(believed)
    assert "Left and right" in render_report(result)
