"""Figures by camera and keypoint: reprojection errors, and shares of detections used, rejected and missing."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posefuse.report.heat_map import MISSING, REJECTED, USED
from posefuse.report.numbers import format_three_digits
from posefuse.report.plots.data import PAGE_WIDTH_IN, DrawFigure, PlotData
from posefuse.report.rendering import INK

_MAX_LABELED_CELLS = 600
"""Heat maps with more cells than this are drawn without numbers."""


def plot_errors(data: PlotData) -> DrawFigure:
    """Draw the median and the 90th percentile of the reprojection error."""
    panels = [
        ("median reprojection error, px", data.heat_map.error_px, "Oranges"),
        ("90th percentile, px", data.heat_map.p90_px, "Oranges"),
    ]
    return lambda: _draw_heat_maps(data, panels, format_three_digits)


def plot_shares(data: PlotData) -> DrawFigure:
    """Draw the shares of detections that were used, rejected and missing."""
    named = (
        ("used, %", USED, "Blues"),
        ("rejected or not used, %", REJECTED, "Oranges"),
        ("missing, %", MISSING, "Greys"),
    )
    panels = [(title, 100 * data.heat_map.shares[..., code], colors) for title, code, colors in named]
    return lambda: _draw_heat_maps(data, panels, lambda value: "-" if np.isnan(value) else f"{value:.0f}")


def _draw_heat_maps(
    data: PlotData, panels: Sequence[tuple[str, np.ndarray, str]], format_value: Callable[[float], str]
) -> Figure:
    """Draw one map per panel: one row per keypoint, one column per camera."""
    n_keypoints, n_views = panels[0][1].shape
    width = max(PAGE_WIDTH_IN, len(panels) * 0.32 * n_views + 1.5)
    figure = Figure(figsize=(width, 0.19 * n_keypoints + 1.0), layout="constrained")
    grid = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axes, (title, values, colors) in zip(grid, panels, strict=True):
        finite = values[np.isfinite(values)]
        top = 100.0 if "%" in title else float(finite.max()) if finite.size else 1.0
        axes.imshow(values, cmap=colors, vmin=0, vmax=1.5 * top, aspect="auto", interpolation="nearest")
        axes.set_title(title)
        axes.set_xticks(range(n_views), data.result.rig.names, rotation=40, ha="right")
        axes.tick_params(length=0)
        axes.spines[["left", "bottom"]].set_visible(False)
        if values.size <= _MAX_LABELED_CELLS:
            _label_cells(axes, values, 0.95 * top, format_value)
    grid[0].set_yticks(range(n_keypoints), data.result.skeleton.keypoints)
    return figure


def _label_cells(axes: Axes, values: np.ndarray, dark: float, format_value: Callable[[float], str]) -> None:
    for (k, v), value in np.ndenumerate(values):
        axes.text(v, k, format_value(value), ha="center", va="center", size=6, color="white" if value > dark else INK)
