"""Figure of the agreement of joint angles with a reference: one Bland-Altman plot per angle."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posefuse.evaluation.angle_agreement import AngleAgreement, AngleComparison
from posefuse.report.matplotlib_extra import BLUE, ORANGE
from posefuse.report.rendering import GRAY, RenderedFigure, render_figure

_COLUMNS = 4
_MAX_POINTS = 1500
"""Largest number of points per panel, evenly spread over the recording."""


def agreement_figure(comparison: AngleComparison) -> RenderedFigure:
    """Draw differences over means for every compared angle, with bias and 95 % limits of agreement."""
    return render_figure(lambda: _draw(comparison))


def _draw(comparison: AngleComparison) -> Figure:
    shown = [angle for angle in comparison.angles if angle.n and np.isfinite(angle.bias_deg)]
    columns = min(_COLUMNS, max(len(shown), 2))
    rows = max(1, -(-len(shown) // columns))
    figure = Figure(figsize=(2.35 * columns, 1.8 * rows + 0.4), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, angle in zip(grid.flat, shown, strict=False):
        _draw_angle(axes, angle)
    for axes in list(grid.flat)[len(shown) :]:
        axes.set_visible(False)
    for axes in grid[:, 0]:
        axes.set_ylabel("difference, deg")
    for axes in list(grid.flat)[max(0, len(shown) - columns) : len(shown)]:
        axes.set_xlabel("mean, deg")
    figure.suptitle(f"{comparison.result} minus {comparison.reference}", size=8)
    return figure


def _draw_angle(axes: Axes, angle: AngleAgreement) -> None:
    step = -(-angle.n // _MAX_POINTS)
    axes.plot(
        angle.means_deg[::step], angle.differences_deg[::step], ".", color=BLUE, markersize=2, alpha=0.5, linewidth=0
    )
    axes.axhline(0.0, color=GRAY, linewidth=0.6)
    axes.axhline(angle.bias_deg, color=ORANGE, linewidth=1.0)
    for limit in angle.limits_deg:
        axes.axhline(limit, color=ORANGE, linewidth=0.8, linestyle=(0, (3, 1.5)))
    axes.set_title(angle.angle, size=8)
    reach = 1.15 * max(2.0, *np.abs(angle.limits_deg), float(np.abs(angle.differences_deg).max()))
    axes.set_ylim(-reach, reach)
