"""Tables of the report of a calibration."""

import re
from dataclasses import replace

import numpy as np

from posefuse.report.calibration.tables import camera_table, length_table, shared_table, volume_table
from tests.calibration_summaries import board_summary, with_camera


def cells(table):
    rows = re.findall(r"<tr>(.*?)(?=</tr>|<tr>|</table>)", table, flags=re.DOTALL)
    return [
        [re.sub(r"<[^>]*>", "", cell).strip() for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)] for row in rows
    ]


def test_estimated_lenses_have_a_standard_deviation():
    summary = with_camera(board_summary(), 1, focal_sd_px=2.5, lens_given=False)
    rows = cells(camera_table(summary))
    column = rows[0].index("Focal length, px")
    assert rows[1][column] == "800"
    assert rows[2][column] == "840.0 ± 2.5"


def test_unknown_columns_are_left_out():
    summary = board_summary()
    for v in range(3):
        summary = with_camera(summary, v, offset_sd_s=float("nan"))
    assert "Time offset" not in camera_table(summary)
    assert "moves at" not in volume_table(summary)


def test_shared_frames_are_those_of_the_summary():
    summary = replace(board_summary(), shared=np.array([[9, 1, 2], [1, 8, 3], [2, 3, 7]]))
    rows = cells(shared_table(summary))
    assert [row[1:] for row in rows[1:]] == [["9", "1", "2"], ["1", "8", "3"], ["2", "3", "7"]]


def test_lengths_are_shown_if_there_are_any():
    assert "distances on the board" in length_table(board_summary())
    assert length_table(replace(board_summary(), lengths=())) == ""
