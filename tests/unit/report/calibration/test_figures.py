"""Drawings of a calibration."""

import re

import numpy as np
import pytest

from posefuse.report.calibration.figures import arrow_scale_px, image_figure, scatter_figure
from tests.calibration_summaries import board_summary, with_camera


def test_cells_have_the_number_of_their_points():
    summary = board_summary()
    figure = image_figure(summary.rig.cameras[1], summary.cameras[1], 1.0)
    counts = [int(n) for n in re.findall(r"<title>(\d+) points", figure)]
    assert sum(counts) == len(summary.cameras[1].pixels)


def test_lines_point_where_residuals_do():
    summary = board_summary()
    shifted = with_camera(summary, 1, residual_px=summary.cameras[1].residual_px + np.array([2.0, 0.0]))
    scale = arrow_scale_px(shifted)
    assert scale == 5.0
    figure = image_figure(shifted.rig.cameras[1], shifted.cameras[1], scale)
    lines = re.findall(r'<line x1="([\d.]+)" y1="([\d.]+)" x2="([\d.]+)" y2="([\d.]+)"', figure)
    assert len(lines) > 5
    for x1, _, x2, _ in lines:
        # 2 of 5 px, as a share of the height of a cell: 270 / 8.
        assert float(x2) - float(x1) == pytest.approx(0.4 * 270 / 8, abs=1.5)


def test_circle_has_the_radius_of_the_error():
    summary = board_summary()
    figure = scatter_figure(summary.rig.cameras[1], summary.cameras[1], 1.0)
    radius = float(re.findall(r'class="ring"[^>]* r="([\d.]+)"', figure)[0])
    assert radius == pytest.approx(75 * summary.cameras[1].error_px, abs=0.1)
