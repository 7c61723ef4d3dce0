"""Figure of the percentile filter's effect: errors before and after, by frame, camera and keypoint.

Source: FreeMoCap's documentation, "Reprojection Error Filtering". Its figure shows the mean over a frame, and the
documentation warns that this hides individual cameras and keypoints. This figure has separate panels for them.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posefuse.evaluation.error_profile import ErrorProfile
from posefuse.model.reconstruction import Reconstruction
from posefuse.report.matplotlib_extra import BLUE, ORANGE
from posefuse.report.numbers import format_three_digits
from posefuse.report.rendering import GRAY, INK, PALE, RenderedFigure, render_figure

_WIDTH_IN = 8.5


def percentile_filter_figure(before: ErrorProfile, after: ErrorProfile, result: Reconstruction) -> RenderedFigure:
    """Draw the effect of the method ``percentile_filter``.

    Args:
        before: error profile of the method ``simple`` on the same recording.
        after: error profile of ``result``.
        result: a result of the method ``percentile_filter``; its options hold the threshold.
    """
    return render_figure(lambda: _draw(before, after, result))


def _draw(before: ErrorProfile, after: ErrorProfile, result: Reconstruction) -> Figure:
    chosen = result.resolved.triangulation.percentile_filter
    threshold = chosen.threshold_px
    assert threshold is not None
    n_views, n_keypoints = len(result.rig), len(result.skeleton)
    heights = [2.1, 0.17 * n_views + 0.55, 0.17 * n_keypoints + 0.55]
    figure = Figure(figsize=(_WIDTH_IN, sum(heights) + 0.4), layout="constrained")
    figure.suptitle(
        f"percentile_filter: views with errors above {format_three_digits(threshold)} px are dropped. Missing points: "
        f"{100 * before.missing_share:.1f} % before, {100 * after.missing_share:.1f} % after.",
        x=0.01, ha="left", size=9,
    )  # fmt: skip
    grid = figure.add_gridspec(3, 2, height_ratios=heights)
    _draw_frame_means(figure.add_subplot(grid[0, :]), before, after, threshold)
    names = [(camera, i) for i, camera in enumerate(result.rig.names)]
    panels = (
        (1, names, "view", "by camera"),
        (2, [(name, i) for i, name in enumerate(result.skeleton.keypoints)], "keypoint", "by keypoint"),
    )
    for row, labels, axis, title in panels:
        left = figure.add_subplot(grid[row, 0])
        right = figure.add_subplot(grid[row, 1], sharey=left)
        for axes, kind, label in ((left, "mean", "mean"), (right, "p95", "95th percentile")):
            values = [getattr(profile, f"{axis}_{kind}_px") for profile in (before, after)]
            _draw_dots(axes, [name for name, _ in labels], values[0], values[1], threshold)
            axes.set_title(f"{title}: {label}")
        right.tick_params(labelleft=False)
    return figure


def _draw_frame_means(axes: Axes, before: ErrorProfile, after: ErrorProfile, threshold_px: float) -> None:
    """Draw the mean error of each frame."""
    axes.plot(*_with_gaps(before), color=GRAY, linewidth=0.9)
    axes.plot(*_with_gaps(after), color=BLUE, linewidth=0.9)
    axes.axhline(threshold_px, color=ORANGE, linewidth=0.9, linestyle=(0, (3, 1.5)))
    high = np.nanmax([threshold_px, *before.frame_mean_px, *after.frame_mean_px])
    first, last = int(before.frame_numbers[0]), int(before.frame_numbers[-1])
    axes.set(xlim=(first, max(last, first + 1)), ylim=(0, 1.05 * high), xlabel="frame", ylabel="px")
    axes.set_title("by frame: mean reprojection error over the views used")
    for place, text, color in ((0.82, "before (simple)", GRAY), (0.89, "after", BLUE), (1.0, "threshold", ORANGE)):
        axes.text(place, 1.04, text, color=color, weight="bold", ha="right", transform=axes.transAxes)


def _with_gaps(profile: ErrorProfile) -> tuple[np.ndarray, np.ndarray]:
    """Return frame numbers and means, with NaN where frame numbers are not consecutive."""
    numbers = profile.frame_numbers.astype(np.float64)
    gaps = np.flatnonzero(np.diff(numbers) > 1) + 1
    return np.insert(numbers, gaps, np.nan), np.insert(profile.frame_mean_px, gaps, np.nan)


def _draw_dots(
    axes: Axes, names: Sequence[str], before_px: np.ndarray, after_px: np.ndarray, threshold_px: float
) -> None:
    """Draw one line per name, from top to bottom, from the value before to the value after."""
    places = np.arange(len(names))
    axes.hlines(places, before_px, after_px, color=PALE, linewidth=1.5)
    axes.plot(before_px, places, "o", color=GRAY, markersize=4)
    axes.plot(after_px, places, "o", color=BLUE, markersize=4)
    axes.axvline(threshold_px, color=ORANGE, linewidth=0.9, linestyle=(0, (3, 1.5)))
    high = np.nanmax([threshold_px, *before_px, *after_px])
    axes.set(xlim=(0, 1.05 * high), ylim=(len(names) - 0.5, -0.5), xlabel="px")
    axes.set_yticks(places, names, color=INK)
    axes.tick_params(axis="y", length=0)
