"""The figures of a result: adding one takes a drawing function and one record in :data:`PLOTS`."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from posefuse.errors import OptionsError, suggestion
from posefuse.report.matplotlib_extra import require_matplotlib

if TYPE_CHECKING:
    from posefuse.report.plots.data import PlotData
    from posefuse.report.rendering import RenderedFigure


@dataclass(frozen=True)
class Plot:
    """One figure of a result.

    Attributes:
        name: name on the command line and stem of the file names.
        title: short title.
        description: what the figure shows, in one sentence.
        requires: what a result needs for this figure.
        module: module of the drawing function, imported only when the figure is drawn.
        function: name of a function that takes a ``PlotData`` and returns a function that draws a matplotlib figure,
            or None if the result lacks what ``requires`` names.
    """

    name: str
    title: str
    description: str
    requires: str
    module: str
    function: str

    def load(self) -> Callable[["PlotData"], Callable[[], Any] | None]:
        """Return the drawing function."""
        return getattr(import_module(self.module), self.function)


PLOTS = (
    Plot(
        "errors",
        "Reprojection error by camera and keypoint",
        "Median and 90th percentile of the reprojection error for each camera and keypoint.",
        "at least one person",
        "posefuse.report.plots.heat_maps",
        "plot_errors",
    ),
    Plot(
        "shares",
        "Detections by camera and keypoint",
        "Share of detections used, rejected and missing for each camera and keypoint.",
        "at least one person",
        "posefuse.report.plots.heat_maps",
        "plot_shares",
    ),
    Plot(
        "time",
        "Error and views over time",
        "Reprojection error and number of views used over time, one line per subject.",
        "at least one person",
        "posefuse.report.plots.time_lines",
        "plot_error_and_views",
    ),
    Plot(
        "gaps",
        "Gaps over time",
        "When each keypoint was measured, filled or missing, one panel per subject.",
        "at least one person",
        "posefuse.report.plots.gaps",
        "plot_gaps",
    ),
    Plot(
        "bones",
        "Bone lengths over time",
        "Measured lengths of the eight bones that vary most.",
        "a skeleton with edges",
        "posefuse.report.plots.time_lines",
        "plot_bones",
    ),
    Plot(
        "lives",
        "Track states over time",
        "When each track was tentative, active and lost, with its events.",
        "tracks",
        "posefuse.report.plots.track_states",
        "plot_track_states",
    ),
    Plot(
        "trajectories",
        "Keypoint trajectories",
        "Coordinates of the selected keypoints over time, with bands of one standard deviation.",
        "at least one person",
        "posefuse.report.plots.time_lines",
        "plot_trajectories",
    ),
    Plot(
        "angles",
        "Joint angles over time",
        "The selected joint angles, or the eight with the largest range, left and right overlaid, with bands of one "
        "standard deviation.",
        "joint angles",
        "posefuse.report.plots.angles",
        "plot_angles",
    ),
    Plot(
        "gait",
        "Gait cycles",
        "Mean joint angles over the gait cycle, left and right overlaid, with bands of one standard deviation.",
        "a person with heels and toes who walks or runs",
        "posefuse.report.plots.gait",
        "plot_gait",
    ),
)
"""All figures, in the order in which they are listed and drawn."""

PLOT_NAMES = tuple(plot.name for plot in PLOTS)


def find_plot(name: str) -> Plot:
    """Return the record of a figure.

    Raises:
        OptionsError: if there is no figure of that name.
    """
    for plot in PLOTS:
        if plot.name == name:
            return plot
    raise OptionsError(f"`figure`: unknown figure {name!r}. {suggestion(name, PLOT_NAMES)}")


def draw_plot(name: str, data: "PlotData") -> "RenderedFigure | None":
    """Draw a figure of :data:`PLOTS`.

    Returns:
        The rendered figure, or None if the result has nothing to draw in it.

    Raises:
        ResultError: if matplotlib is not installed.
        OptionsError: if there is no such figure, or ``data`` names a joint angle that the result does not have.
    """
    require_matplotlib()
    from posefuse.report.rendering import render_figure

    plot = find_plot(name)
    if not data.result.person_ids or not data.result.n_frames:
        return None
    draw = plot.load()(data)
    return None if draw is None else render_figure(draw)
