"""Figures over time with one line per person: errors, bone lengths and trajectories."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from posefuse.report.plots.data import MAX_PANELS, PAGE_WIDTH_IN, PERSON_COLORS, DrawFigure, PlotData, time_axis
from posefuse.report.series import mean_per_interval

_DASHES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))


def plot_error_and_views(data: PlotData) -> DrawFigure:
    """Draw the mean reprojection error and the mean number of views used."""
    starts = data.series.interval_starts()
    panels = [
        ("mean reprojection error, px", mean_per_interval(data.series.error_px, starts)),
        ("mean number of views used", mean_per_interval(data.series.n_views, starts)),
    ]
    return lambda: _draw_panels(data, panels, starts)


def plot_bones(data: PlotData) -> DrawFigure | None:
    """Draw the measured lengths of the bones that vary most."""
    if not data.series.bones:
        return None
    lengths = data.series.bones_m.astype(np.float64)
    scale, unit = (1000.0, "mm") if data.result.unit == "m" else (1.0, data.result.unit)
    variations = np.array([_relative_variation(lengths[:, :, b]) for b in range(lengths.shape[2])])
    worst = np.argsort(-np.nan_to_num(variations), kind="stable")[:MAX_PANELS]
    starts = data.series.interval_starts()
    panels = [
        (f"{' to '.join(data.series.bones[b])}, {unit}", mean_per_interval(scale * lengths[:, :, b], starts))
        for b in sorted(worst)
    ]
    return lambda: _draw_panels(data, panels, starts)


def _relative_variation(lengths: np.ndarray) -> float:
    """Return the largest ratio of median absolute deviation to median length over all people."""
    ratios = [0.0]
    for column in lengths.T:
        finite = column[np.isfinite(column)]
        if len(finite) and np.median(finite) > 0:
            ratios.append(float(np.median(np.abs(finite - np.median(finite))) / np.median(finite)))
    return max(ratios)


def plot_trajectories(data: PlotData) -> DrawFigure:
    """Draw the coordinates of keypoints with bands of one standard deviation; missing frames are left blank."""
    parts = list(data.result.chunks())
    indices = [data.result.skeleton.index(name) for name in data.keypoints]
    points = np.concatenate([np.asarray(part.layers[data.layer].points_m[:])[:, :, indices] for part in parts])
    deviations = np.concatenate([part.layers[data.layer].sd_m[:, :, indices] for part in parts])
    panels, bands = [], []
    for i, name in enumerate(data.keypoints):
        for axis in range(2 if data.result.unit != "m" else 3):
            panels.append((f"{name}, {'xyz'[axis]}, {data.result.unit}", points[:, :, i, axis]))
            bands.append(deviations[:, :, i, axis])
    return lambda: _draw_panels(data, panels, np.arange(data.result.n_frames), bands)


def _draw_panels(
    data: PlotData,
    panels: Sequence[tuple[str, np.ndarray]],
    frame_indices: np.ndarray,
    bands: Sequence[np.ndarray] = (),
) -> Figure:
    """Draw stacked panels, each with a title and values of shape (frame index, person)."""
    times, unit = time_axis(data.result)
    person_ids = data.result.person_ids
    figure = Figure(figsize=(PAGE_WIDTH_IN, 1.15 * len(panels) + 0.6), layout="constrained")
    grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for i, (axes, (title, values)) in enumerate(zip(grid, panels, strict=True)):
        for p, name in enumerate(person_ids):
            color, dash = PERSON_COLORS[p % len(PERSON_COLORS)], _DASHES[p % len(_DASHES)]
            axes.plot(times[frame_indices], values[:, p], color=color, linestyle=dash, linewidth=0.9, label=name)
            if bands:
                low, high = values[:, p] - bands[i][:, p], values[:, p] + bands[i][:, p]
                axes.fill_between(times[frame_indices], low, high, color=color, alpha=0.2, linewidth=0)
        axes.set_title(title)
        axes.set_xlim(times[0], times[-1] if times[-1] > times[0] else times[0] + 1)
    grid[-1].set_xlabel(unit)
    if len(person_ids) > 1:
        grid[0].legend(
            frameon=False, ncols=5, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, fontsize=7
        )
    return figure
