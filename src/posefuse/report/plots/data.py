"""The numbers that figures of a result are drawn from."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.figure import Figure

from posefuse.biomechanics.gait import Gait
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.report.heat_map import HeatMap, gather_heat_map
from posefuse.report.matplotlib_extra import BLUE, ORANGE
from posefuse.report.series import TimeSeries, gather_series

DrawFigure = Callable[[], Figure]
"""Draws a figure; called with the plotting library set to the project's style."""
PERSON_COLORS = (BLUE, ORANGE, "#009e73", "#a3478f", "#8a6d00", "#2a9fd6", "#6a3fb5", "#b3261e", "#4f7f1f", "#5a6470")
PAGE_WIDTH_IN = 7.5
MAX_PANELS = 8


@dataclass(frozen=True, eq=False)
class PlotData:
    """What the figures of a result are drawn from.

    Attributes:
        result: the whole result.
        layer: the layer that is drawn.
        keypoints: names of the keypoints of the trajectories figure.
        angles: names of the joint angles of the angles figure; empty for the default choice.
        heat_map: errors and shares of detections by keypoint and camera.
        series: numbers of every frame.
        gait: contacts, gait and repetitions by person.
    """

    result: Reconstruction
    layer: LayerName
    keypoints: tuple[str, ...]
    angles: tuple[str, ...]
    heat_map: HeatMap
    series: TimeSeries
    gait: Mapping[str, Gait] = field(default_factory=dict)


def gather_plot_data(
    result: Reconstruction,
    layer: LayerName | None,
    keypoints: Sequence[str] = (),
    angles: Sequence[str] = (),
    gait: Mapping[str, Gait] | None = None,
) -> PlotData:
    """Gather the numbers that figures are drawn from.

    Args:
        result: the result to draw.
        layer: the layer to draw, or None for the best one.
        keypoints: keypoints of the trajectories figure; by default the skeleton's first core keypoint.
        angles: joint angles of the angles figure; by default the eight with the largest range.
        gait: contacts, gait and repetitions by person.

    Raises:
        ResultError: if the result has no such layer.
        SkeletonError: if the skeleton has no such keypoint.
    """
    name, _ = result.best_layer(layer)
    for keypoint in keypoints:
        result.skeleton.index(keypoint)
    chosen = tuple(keypoints) or (result.skeleton.keypoints[int(result.skeleton.core_indices[0])],)
    series = gather_series(result.chunks(), name, result.skeleton)
    heat_map = gather_heat_map(result.chunks(), name, result.n_frames)
    return PlotData(result, name, chosen, tuple(angles), heat_map, series, gait or {})


def time_axis(result: Reconstruction) -> tuple[np.ndarray, str]:
    """Return the times of the frames and their unit: seconds, or frame numbers if any time is unknown."""
    if np.isfinite(result.time_s).all():
        return result.time_s, "s"
    return result.frame_numbers.astype(np.float64), "frame"
