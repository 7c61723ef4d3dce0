"""Figure of when each keypoint was measured, filled and missing."""

from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from posefuse.report.plots.data import MAX_PANELS, PAGE_WIDTH_IN, DrawFigure, PlotData, time_axis
from posefuse.report.rendering import INK
from posefuse.report.series import FILLED, MEASURED, majority_per_interval

_STATE_COLORS = ("#7a1f5c", "#9ccbe8", "#f0b400", "#ffffff")


def plot_gaps(data: PlotData) -> DrawFigure:
    """Draw when each keypoint was measured, filled and missing, one panel per person."""
    point_state = majority_per_interval(data.series.point_state, data.series.interval_starts())
    names = data.result.person_ids[:MAX_PANELS]

    def draw() -> Figure:
        times, unit = time_axis(data.result)
        n_keypoints = point_state.shape[2]
        figure = Figure(figsize=(PAGE_WIDTH_IN, len(names) * (0.12 * n_keypoints + 0.5) + 0.5), layout="constrained")
        grid = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        extent = [times[0], times[-1] if times[-1] > times[0] else times[0] + 1, n_keypoints - 0.5, -0.5]
        for p, axes in enumerate(grid):
            axes.imshow(
                point_state[:, p].T, cmap=ListedColormap(list(_STATE_COLORS)), vmin=0, vmax=3, aspect="auto",
                interpolation="nearest", extent=extent,
            )  # fmt: skip
            axes.set_title(names[p])
            axes.set_yticks(range(n_keypoints), data.result.skeleton.keypoints, size=5)
            axes.tick_params(axis="y", length=0)
        for x, code, word in ((1.0, 0, "missing"), (0.88, FILLED, "filled or held"), (0.7, MEASURED, "measured")):
            text = (
                {"color": INK, "backgroundcolor": _STATE_COLORS[code]}
                if code
                else {"color": "white", "backgroundcolor": _STATE_COLORS[0]}
            )
            grid[0].text(x, 1.06, word, ha="right", size=7, transform=grid[0].transAxes, **text)
        grid[-1].set_xlabel(unit)
        return figure

    return draw
