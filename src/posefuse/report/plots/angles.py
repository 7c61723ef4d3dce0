"""The figure of joint angles over time, left and right overlaid."""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posefuse.errors import OptionsError, choices, suggestion
from posefuse.model.joint_angles import JointAngles
from posefuse.report.movement import SIDE_COLORS
from posefuse.report.plots.data import MAX_PANELS, PAGE_WIDTH_IN, PERSON_COLORS, DrawFigure, PlotData, time_axis

_DASHES = {"both": "-", "left": "-", "right": (0, (4, 1.5))}
_ONE_PERSON = {**SIDE_COLORS, "both": "#222222"}
_COLUMNS = 2


class _Panel(NamedTuple):
    """One panel: the index of an angle by side."""

    title: str
    angles: dict[str, int]


def plot_angles(data: PlotData) -> DrawFigure | None:
    """Draw joint angles with bands of one standard deviation.

    Raises:
        OptionsError: if ``data`` names an angle that the result does not have.
    """
    angles = data.result.joint_angles
    if angles is None:
        return None
    for name in data.angles:
        if name not in angles.names:
            raise OptionsError(
                f"`angle`: unknown angle {name!r}. {suggestion(name, angles.names)} Available angles: "
                f"{choices(angles.names, 40)}."
            )
    degrees, sd_deg = np.asarray(angles.degrees[:]), np.asarray(angles.sd_deg[:])
    panels = [_Panel(name, {"both": angles.index(name)}) for name in data.angles] or _most_mobile(angles, degrees)
    return (lambda: _draw(data, panels, degrees, sd_deg)) if panels else None


def _most_mobile(angles: JointAngles, degrees: np.ndarray) -> list[_Panel]:
    """Return the panels of the first convention with the largest range between the 5th and 95th percentiles."""
    panels, ranges = [], []
    for name, (left, right) in angles.sides(angles.conventions[0]).items():
        of = {"both": left} if left == right else {"left": left, "right": right}
        of = {side: i for side, i in of.items() if i >= 0 and np.isfinite(degrees[:, :, i]).any()}
        if of:
            panels.append(_Panel(name, of))
            ranges.append(max(_range_deg(degrees[:, :, i]) for i in of.values()))
    return [panels[i] for i in sorted(np.argsort(-np.array(ranges), kind="stable")[:MAX_PANELS].tolist())]


def _range_deg(degrees: np.ndarray) -> float:
    return float(np.subtract(*np.percentile(degrees[np.isfinite(degrees)], (95, 5))))


def _draw(data: PlotData, panels: list[_Panel], degrees: np.ndarray, sd_deg: np.ndarray) -> Figure:
    columns = min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(PAGE_WIDTH_IN, 1.5 * rows + 0.5), layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    times, unit = time_axis(data.result)
    handles = {}
    for axes, panel in zip(grid, panels, strict=False):
        for side, i in panel.angles.items():
            handles |= _draw_side(axes, data, side, times, degrees[:, :, i], sd_deg[:, :, i])
        axes.set_title(f"{panel.title.replace('_', ' ')}, degrees")
        axes.set_xlim(times[0], times[-1] if times[-1] > times[0] else times[0] + 1)
    for axes in grid[len(panels) :]:
        axes.set_visible(False)
    for axes in grid[max(len(panels) - columns, 0) : len(panels)]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel(unit)
    if len(handles) > 1:
        figure.legend(handles.values(), handles.keys(), frameon=False, ncols=5, loc="outside upper right", fontsize=7)
    return figure


def _draw_side(
    axes: Axes, data: PlotData, side: str, times: np.ndarray, degrees: np.ndarray, sd_deg: np.ndarray
) -> dict[str, object]:
    """Draw the angles of all people on one side, shape (frame, person) each, and return the lines by label."""
    found = {}
    people = data.result.person_ids
    for p, person in enumerate(people):
        color = PERSON_COLORS[p % len(PERSON_COLORS)] if len(people) > 1 else _ONE_PERSON[side]
        style = _DASHES[side] if len(people) > 1 else "-"
        words = (person if len(people) > 1 else "", side if side != "both" else "")
        (line,) = axes.plot(times, degrees[:, p], color=color, linestyle=style, linewidth=0.9)
        low, high = degrees[:, p] - sd_deg[:, p], degrees[:, p] + sd_deg[:, p]
        axes.fill_between(times, low, high, color=color, alpha=0.2, linewidth=0)
        label = ", ".join(word for word in words if word)
        if label:
            found[label] = line
    return found
