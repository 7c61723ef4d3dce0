"""The figure of gait: mean cycles of joint angles, left and right overlaid, with the time of toe-off."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posefuse.biomechanics.cycles import PERCENT, Cycle
from posefuse.biomechanics.foot_paths import SIDES
from posefuse.biomechanics.gait import Gait
from posefuse.biomechanics.gait_parameters import mean_of
from posefuse.report.movement import SIDE_COLORS, shown_signals, signal_title
from posefuse.report.plots.data import PAGE_WIDTH_IN, DrawFigure, PlotData

_COLUMNS = 3
_ROW_HEIGHT_IN = 1.55


def plot_gait(data: PlotData) -> DrawFigure | None:
    """Draw the mean gait cycles of every person who walks, with bands of one standard deviation over cycles."""
    people = {person: gait for person, gait in data.gait.items() if gait.cycles}
    if not people:
        return None
    return lambda: _draw(people)


def _draw(people: dict[str, Gait]) -> Figure:
    signals = {person: shown_signals(gait.cycles) for person, gait in people.items()}
    rows = [-(-len(each) // _COLUMNS) for each in signals.values()]
    figure = Figure(figsize=(PAGE_WIDTH_IN, _ROW_HEIGHT_IN * sum(rows) + 0.3 * len(rows)), layout="constrained")
    parts = np.atleast_1d(np.asarray(figure.subfigures(len(rows), 1, height_ratios=rows)))
    for part, n_rows, (person, gait) in zip(parts, rows, people.items(), strict=True):
        if len(people) > 1:
            part.suptitle(person, fontsize=9)
        grid = part.subplots(n_rows, _COLUMNS, sharex=True, squeeze=False).ravel()
        for axes, signal in zip(grid, signals[person], strict=False):
            _draw_cycles(axes, [each for each in gait.cycles if each.signal == signal], gait)
            axes.set_title(signal_title(signal))
        for axes in grid[len(signals[person]) :]:
            axes.set_visible(False)
        for axes in grid[max(len(signals[person]) - _COLUMNS, 0) : len(signals[person])]:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel("gait cycle, %")
        grid[0].legend(frameon=False, fontsize=7, loc="best")
    return figure


def _draw_cycles(axes: Axes, cycles: Sequence[Cycle], gait: Gait) -> None:
    """Draw the cycles of both sides, and a vertical line at the mean end of the stance of each."""
    for cycle in cycles:
        color = SIDE_COLORS[cycle.side]
        axes.plot(PERCENT, cycle.mean, color=color, linewidth=1.1, label=f"{cycle.side}, {int(cycle.n.max())} cycles")
        axes.fill_between(PERCENT, cycle.mean - cycle.sd, cycle.mean + cycle.sd, color=color, alpha=0.2, linewidth=0)
    for side in SIDES:
        stance = mean_of(gait.parameters, "stance_percent", side)
        if stance is not None:
            axes.axvline(stance.value, color=SIDE_COLORS[side], linewidth=0.7, linestyle=(0, (3, 2)))
    axes.set_xlim(0, 100)
