"""What the percentile filter did: errors before and after, frame by frame, camera by camera, keypoint by keypoint.

Source: FreeMoCap's documentation, "Reprojection Error Filtering", which has a figure of the mean over a frame and warns
that it hides what happens to single cameras and keypoints. Those have panels of their own here.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from posefuse.evaluation.filtering import ErrorProfile
from posefuse.model.reconstruction import Reconstruction
from posefuse.report.figures import BLUE, GREY, INK, ORANGE, PALE, Picture, picture
from posefuse.report.numbers import three_digits

_WIDTH_IN = 8.5


def filter_picture(before: ErrorProfile, after: ErrorProfile, result: Reconstruction) -> Picture:
    """The figure.

    Args:
        before: of the method ``simple`` on the same recording.
        after: of ``result``.
        result: by the method ``percentile_filter``; its options hold the threshold.
    """
    return picture(lambda: _draw(before, after, result))


def _draw(before: ErrorProfile, after: ErrorProfile, result: Reconstruction) -> Figure:
    chosen = result.options.triangulation.percentile_filter
    threshold = chosen.threshold_px
    assert threshold is not None
    n_views, n_keypoints = len(result.rig), len(result.skeleton)
    heights = [2.1, 0.17 * n_views + 0.55, 0.17 * n_keypoints + 0.55]
    figure = Figure(figsize=(_WIDTH_IN, sum(heights) + 0.4), layout="constrained")
    figure.suptitle(
        f"percentile_filter: views more than {three_digits(threshold)} px off are dropped. Points missing: "
        f"{100 * before.missing_share:.1f} % before, {100 * after.missing_share:.1f} % after.",
        x=0.01, ha="left", size=9,
    )  # fmt: skip
    grid = figure.add_gridspec(3, 2, height_ratios=heights)
    _frames(figure.add_subplot(grid[0, :]), before, after, threshold)
    names = [(camera, i) for i, camera in enumerate(result.rig.names)]
    panels = (
        (1, names, "view", "by camera"),
        (2, [(name, i) for i, name in enumerate(result.skeleton.keypoints)], "keypoint", "by keypoint"),
    )
    for row, labels, axis, title in panels:
        left = figure.add_subplot(grid[row, 0])
        right = figure.add_subplot(grid[row, 1], sharey=left)
        for axes, kind, words in ((left, "mean", "mean"), (right, "p95", "95 % of the errors lie below")):
            values = [getattr(profile, f"{axis}_{kind}_px") for profile in (before, after)]
            _dots(axes, [name for name, _ in labels], values[0], values[1], threshold)
            axes.set_title(f"{title}: {words}")
        right.tick_params(labelleft=False)
    return figure


def _frames(axes: Axes, before: ErrorProfile, after: ErrorProfile, threshold_px: float) -> None:
    """The mean over each frame."""
    axes.plot(*_with_gaps(before), color=GREY, linewidth=0.9)
    axes.plot(*_with_gaps(after), color=BLUE, linewidth=0.9)
    axes.axhline(threshold_px, color=ORANGE, linewidth=0.9, linestyle=(0, (3, 1.5)))
    high = np.nanmax([threshold_px, *before.frame_mean_px, *after.frame_mean_px])
    first, last = int(before.frame_numbers[0]), int(before.frame_numbers[-1])
    axes.set(xlim=(first, max(last, first + 1)), ylim=(0, 1.05 * high), xlabel="frame", ylabel="px")
    axes.set_title("by frame: mean reprojection error over the views used")
    for place, text, color in ((0.82, "before (simple)", GREY), (0.89, "after", BLUE), (1.0, "threshold", ORANGE)):
        axes.text(place, 1.04, text, color=color, weight="bold", ha="right", transform=axes.transAxes)


def _with_gaps(profile: ErrorProfile) -> tuple[np.ndarray, np.ndarray]:
    """Frame numbers and means, a gap where frames are left out."""
    numbers = profile.frame_numbers.astype(np.float64)
    holes = np.flatnonzero(np.diff(numbers) > 1) + 1
    return np.insert(numbers, holes, np.nan), np.insert(profile.frame_mean_px, holes, np.nan)


def _dots(axes: Axes, names: Sequence[str], before_px: np.ndarray, after_px: np.ndarray, threshold_px: float) -> None:
    """A line from before to after for each name, from the top."""
    places = np.arange(len(names))
    axes.hlines(places, before_px, after_px, color=PALE, linewidth=1.5)
    axes.plot(before_px, places, "o", color=GREY, markersize=4)
    axes.plot(after_px, places, "o", color=BLUE, markersize=4)
    axes.axvline(threshold_px, color=ORANGE, linewidth=0.9, linestyle=(0, (3, 1.5)))
    high = np.nanmax([threshold_px, *before_px, *after_px])
    axes.set(xlim=(0, 1.05 * high), ylim=(len(names) - 0.5, -0.5), xlabel="px")
    axes.set_yticks(places, names, color=INK)
    axes.tick_params(axis="y", length=0)
