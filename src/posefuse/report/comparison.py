"""Figure of a comparison of triangulation methods: error distributions, missing points and CPU time."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from posefuse.evaluation.comparison import SHARES, Comparison, ErrorSpread, MethodNumbers
from posefuse.report.matplotlib_extra import BLUE, ORANGE
from posefuse.report.numbers import format_three_digits
from posefuse.report.rendering import GRAY, INK, PALE, RenderedFigure, remove_frame, render_figure

_MAX_COLUMNS = 4
_MISSING = "points missing, %"
_MIN_AXIS_LIMIT = {_MISSING: 10.0}
"""Smallest upper limit of a bar panel's axis, so that few missing points do not look like many."""


def comparison_figure(comparison: Comparison) -> RenderedFigure:
    """Draw one cumulative error distribution per method, with bars below."""
    return render_figure(lambda: _draw(comparison))


def _draw(comparison: Comparison) -> Figure:
    rows = comparison.methods
    columns = min(_MAX_COLUMNS, max(len(rows), 2))
    lines = -(-len(rows) // columns)
    heights = [1.75 * lines + 0.6, 0.2 * len(rows) + 0.6]
    figure = Figure(figsize=(2.35 * columns, sum(heights)), layout="constrained")
    upper, lower = figure.add_gridspec(2, 1, height_ratios=heights)
    _draw_distributions(upper.subgridspec(lines, columns).subplots(sharex=True, sharey=True, squeeze=False), rows)
    bars = _bars(rows)
    panels = lower.subgridspec(1, len(bars)).subplots(sharey=True, squeeze=False)[0]
    for axes, (title, values) in zip(panels, bars.items(), strict=True):
        _draw_bars(axes, title, [row.method for row in rows], values)
    return figure


def _draw_distributions(grid: np.ndarray, rows: Sequence[MethodNumbers]) -> None:
    low_px, high_px = _range_px(rows)
    for axes, row in zip(grid.flat, rows, strict=False):
        for other in rows:
            if other is not row:
                _draw_curve(axes, other.all_error, high_px, color=PALE, linewidth=0.8)
        _draw_curve(axes, row.used_error, high_px, color=BLUE)
        _draw_curve(axes, row.all_error, high_px, color=ORANGE, linestyle=(0, (3, 1.5)))
        axes.set_title(row.method)
        axes.set(xscale="log", xlim=(low_px, high_px), ylim=(0, 101), yticks=(0, 50, 100))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
    for axes in list(grid.flat)[len(rows) :]:
        axes.set_visible(False)
    # A panel above an empty position is the last of its column and carries the axis labels.
    for axes in grid.flat[max(0, len(rows) - grid.shape[1]) : len(rows)]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("reprojection error, px")
    for axes in grid[:, 0]:
        axes.set_ylabel("cumulative share, %")
    legend = (("views it used", BLUE), ("all detections", ORANGE), ("other methods, all", GRAY))
    for line, (text, color) in enumerate(legend):
        grid[0, 0].text(0.97, 0.26 - 0.1 * line, text, color=color, size=7, ha="right", transform=grid[0, 0].transAxes)


def _range_px(rows: Sequence[MethodNumbers]) -> tuple[float, float]:
    """Return the displayed range of errors: the smallest 1st percentile to the largest 99th percentile."""
    errors = [error for row in rows for error in (row.used_error, row.all_error)]
    values = np.concatenate([_between(error, 0.01, 0.99) for error in errors])
    values = values[np.isfinite(values) & (values > 0)]
    if not values.size:
        return 0.1, 100.0
    low, high = float(values.min()), float(values.max())
    return low / 1.1, max(high, 10.0 * low)


def _between(error: ErrorSpread, low: float, high: float) -> np.ndarray:
    return np.array(error.at_shares_px)[(low <= SHARES) & (high >= SHARES)]


def _draw_curve(axes: Axes, error: ErrorSpread, high_px: float, **style: object) -> None:
    """Draw the cumulative share of errors; the curve is flat where the remaining errors are infinite."""
    at_px = np.array(error.at_shares_px)
    finite = np.isfinite(at_px)
    if not finite.any():
        return
    x = np.append(at_px[finite], max(high_px, float(at_px[finite][-1])))
    y = 100.0 * np.append(SHARES[finite], SHARES[finite][-1])
    axes.plot(x, y, **style)  # type: ignore[arg-type]


def _bars(rows: Sequence[MethodNumbers]) -> dict[str, list[float]]:
    """Map each bar panel's title to one value per method; panels without any value are left out."""
    candidates: dict[str, list[float | None]] = {
        _MISSING: [100.0 * row.missing_share for row in rows],
        "median error vs. ground truth, mm": [row.truth_median_mm for row in rows],
        "CPU time per frame, ms": [row.cpu_ms_per_frame for row in rows],
    }
    return {
        title: [float("nan") if value is None else value for value in values]
        for title, values in candidates.items()
        if any(value is not None for value in values)
    }


def _draw_bars(axes: Axes, title: str, names: Sequence[str], values: Sequence[float]) -> None:
    """Draw one labeled bar per method, in order from the top."""
    places = np.arange(len(names))
    lengths = np.nan_to_num(np.array(values))
    axes.barh(places, lengths, height=0.62, color=BLUE)
    for place, value in zip(places, values, strict=True):
        axes.annotate(
            format_three_digits(value), (np.nan_to_num(value), place), xytext=(3, 0), textcoords="offset points",
            va="center", size=7, color=INK,
        )  # fmt: skip
    axes.set_title(title, weight="normal", size=8)
    axes.set_yticks(places, names)
    axes.set_xlim(0, 1.18 * max(float(lengths.max()), _MIN_AXIS_LIMIT.get(title, 1e-9)))
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xticks([])
    remove_frame(axes)
