"""Figure of the states and events of each track over time."""

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posefuse.model.reconstruction import Reconstruction
from posefuse.model.tracks import TrackState
from posefuse.report.plots.data import PAGE_WIDTH_IN, PERSON_COLORS, DrawFigure, PlotData, time_axis
from posefuse.report.rendering import INK, PALE

_LINE_STYLES = {TrackState.ACTIVE: (5.0, "-"), TrackState.TENTATIVE: (1.5, "-"), TrackState.LOST: (1.5, (0, (1, 1)))}


def plot_track_states(data: PlotData) -> DrawFigure | None:
    """Draw one line per person: thick while active, thin while tentative, dotted while lost."""
    tracks = data.result.tracks
    if tracks is None:
        return None
    state = np.asarray(tracks.state[:])
    return lambda: _draw(data.result, state)


def _draw(result: Reconstruction, state: np.ndarray) -> Figure:
    times, unit = time_axis(result)
    ends = np.append(times, times[-1] + (float(np.median(np.diff(times))) if len(times) > 1 else 1.0))
    names = result.person_ids
    figure = Figure(figsize=(PAGE_WIDTH_IN, 0.24 * len(names) + 0.8), layout="constrained")
    axes = figure.subplots()
    for p in range(len(names)):
        _draw_person(axes, p, state[:, p], ends)
    for event in result.events:
        if event.person in names and np.isfinite(event.time_s):
            at = event.time_s if unit == "s" else event.number
            axes.annotate(event.what, (at, names.index(event.person) - 0.2), size=6, color=INK, va="bottom")
    axes.set_yticks(range(len(names)), names, color=INK)
    axes.set(ylim=(len(names) - 0.5, -0.7), xlim=(ends[0], ends[-1]), xlabel=unit)
    axes.grid(axis="x", color=PALE, linewidth=0.5)
    return figure


def _draw_person(axes: Axes, p: int, state: np.ndarray, ends: np.ndarray) -> None:
    cuts = [0, *(np.flatnonzero(np.diff(state)) + 1).tolist(), len(state)]
    color = PERSON_COLORS[p % len(PERSON_COLORS)]
    for start, stop in pairwise(cuts):
        if state[start] == TrackState.ABSENT:
            continue
        width, dash = _LINE_STYLES[TrackState(int(state[start]))]
        axes.plot(ends[[start, stop]], [p, p], color=color, linewidth=width, linestyle=dash, solid_capstyle="butt")
