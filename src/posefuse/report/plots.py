"""A result's figures as PNG and SVG, for papers and slides: the report's numbers in print."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from posefuse.biomechanics.tables import angles_of
from posefuse.errors import OptionsError, choices, suggestion
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.tracks import TrackState
from posefuse.report.cells import MISSING, REJECTED, USED, Cells, cells_of
from posefuse.report.figures import BLUE, INK, ORANGE, PALE, Picture, picture
from posefuse.report.numbers import three_digits
from posefuse.report.series import FILLED, MEASURED, Series, mostly, series_of, stretched

PEOPLE_COLOURS = (BLUE, ORANGE, "#009e73", "#a3478f", "#8a6d00", "#2a9fd6", "#6a3fb5", "#b3261e", "#4f7f1f", "#5a6470")
_DASHES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
_WIDTH_IN = 7.5
_MOST_WRITTEN = 600
"""With more cells than this their numbers are left out of a heat map."""
_MOST_PANELS = 8
_HOW_COLOURS = ("#7a1f5c", "#9ccbe8", "#f0b400", "#ffffff")


@dataclass(frozen=True, eq=False)
class Shown:
    """What figures are drawn of.

    Attributes:
        result: the whole.
        layer: the layer it is drawn of.
        keypoints: names, of the trajectories.
        angles: names, of the angles; the first that there are where none are named.
        cells: of cameras and keypoints.
        series: over time.
    """

    result: Reconstruction
    layer: LayerName
    keypoints: tuple[str, ...]
    angles: tuple[str, ...]
    cells: Cells
    series: Series


def shown_of(
    result: Reconstruction, layer: LayerName | None, keypoints: Sequence[str] = (), angles: Sequence[str] = ()
) -> Shown:
    """Gather what figures are drawn of.

    Args:
        result: of what.
        layer: the layer, or None for the best.
        keypoints: whose trajectories; by default of the first that the skeleton tells people by.
        angles: which of the joint angles; by default the first eight.

    Raises:
        ResultError: if there is no such layer.
        SkeletonError: if there is no such keypoint.
    """
    name, _ = result.best_layer(layer)
    for keypoint in keypoints:
        result.skeleton.index(keypoint)
    chosen = tuple(keypoints) or (result.skeleton.keypoints[int(result.skeleton.core_indices[0])],)
    series = series_of(result.chunks(), name, result.skeleton)
    return Shown(result, name, chosen, tuple(angles), cells_of(result.chunks(), name, result.n_frames), series)


def draw(name: str, shown: Shown) -> Picture | None:
    """A figure of :data:`FIGURES`, or None where the result has nothing to draw in it.

    Raises:
        OptionsError: if there is no such figure, or no such angle.
    """
    if name not in FIGURES:
        raise OptionsError(f"--figure: no figure {name!r}. {suggestion(name, FIGURES)}")
    drawing = FIGURES[name][1]
    if not shown.result.person_ids or not shown.result.n_frames:
        return None
    figure = drawing(shown)
    return None if figure is None else picture(figure)


_Drawing = Callable[[], Figure]


def _errors(shown: Shown) -> _Drawing:
    panels = [
        ("median reprojection error, px", shown.cells.error_px, "Oranges"),
        ("nine in ten below, px", shown.cells.p90_px, "Oranges"),
    ]
    return lambda: _heat_maps(shown, panels, three_digits)


def _shares(shown: Shown) -> _Drawing:
    named = (
        ("used, %", USED, "Blues"),
        ("rejected or not used, %", REJECTED, "Oranges"),
        ("missing, %", MISSING, "Greys"),
    )
    panels = [(title, 100 * shown.cells.shares[..., code], colours) for title, code, colours in named]
    return lambda: _heat_maps(shown, panels, lambda value: "-" if np.isnan(value) else f"{value:.0f}")


def _heat_maps(shown: Shown, panels: Sequence[tuple[str, np.ndarray, str]], words: Callable[[float], str]) -> Figure:
    """A map for each of the panels: keypoints down, cameras across."""
    n_keypoints, n_views = panels[0][1].shape
    width = max(_WIDTH_IN, len(panels) * 0.32 * n_views + 1.5)
    figure = Figure(figsize=(width, 0.19 * n_keypoints + 1.0), layout="constrained")
    grid = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axes, (title, values, colours) in zip(grid, panels, strict=True):
        known = values[np.isfinite(values)]
        top = 100.0 if "%" in title else float(known.max()) if known.size else 1.0
        axes.imshow(values, cmap=colours, vmin=0, vmax=1.5 * top, aspect="auto", interpolation="nearest")
        axes.set_title(title)
        axes.set_xticks(range(n_views), shown.result.rig.names, rotation=40, ha="right")
        axes.tick_params(length=0)
        axes.spines[["left", "bottom"]].set_visible(False)
        if values.size <= _MOST_WRITTEN:
            _write_cells(axes, values, 0.95 * top, words)
    grid[0].set_yticks(range(n_keypoints), shown.result.skeleton.keypoints)
    return figure


def _write_cells(axes: Axes, values: np.ndarray, dark: float, words: Callable[[float], str]) -> None:
    for (k, v), value in np.ndenumerate(values):
        axes.text(v, k, words(value), ha="center", va="center", size=6, color="white" if value > dark else INK)


def _time(shown: Shown) -> _Drawing:
    """Error and views used, a line a person."""
    starts = shown.series.starts()
    panels = [
        ("mean reprojection error, px", stretched(shown.series.error_px, starts)),
        ("mean number of views used", stretched(shown.series.n_views, starts)),
    ]
    return lambda: _line_panels(shown, panels, starts)


def _bones(shown: Shown) -> _Drawing | None:
    """Lengths of the bones that vary most, as measured."""
    if not shown.series.bones:
        return None
    lengths = shown.series.bones_m.astype(np.float64)
    scale, unit = (1000.0, "mm") if shown.result.unit == "m" else (1.0, shown.result.unit)
    shares = np.array([_variation(lengths[:, :, b]) for b in range(lengths.shape[2])])
    worst = np.argsort(-np.nan_to_num(shares), kind="stable")[:_MOST_PANELS]
    starts = shown.series.starts()
    panels = [
        (f"{' to '.join(shown.series.bones[b])}, {unit}", stretched(scale * lengths[:, :, b], starts))
        for b in sorted(worst)
    ]
    return lambda: _line_panels(shown, panels, starts)


def _variation(lengths: np.ndarray) -> float:
    """The greatest robust spread of a person's bone as a share of its length."""
    shares = [0.0]
    for column in lengths.T:
        known = column[np.isfinite(column)]
        if len(known) and np.median(known) > 0:
            shares.append(float(np.median(np.abs(known - np.median(known))) / np.median(known)))
    return max(shares)


def _trajectories(shown: Shown) -> _Drawing:
    """Coordinates of keypoints, every frame, holes where they are missing; their 68 % bands."""
    parts = list(shown.result.chunks())
    places = [shown.result.skeleton.index(name) for name in shown.keypoints]
    points = np.concatenate([np.asarray(part.layers[shown.layer].points_m[:])[:, :, places] for part in parts])
    spread = np.concatenate([part.layers[shown.layer].sd_m[:, :, places] for part in parts])
    panels, bands = [], []
    for i, name in enumerate(shown.keypoints):
        for axis in range(2 if shown.result.unit != "m" else 3):
            panels.append((f"{name}, {'xyz'[axis]}, {shown.result.unit}", points[:, :, i, axis]))
            bands.append(spread[:, :, i, axis])
    return lambda: _line_panels(shown, panels, np.arange(shown.result.n_frames), bands)


def _angles(shown: Shown) -> _Drawing | None:
    """Joint angles, every frame."""
    gathered = [angles_of(part) for part in shown.result.chunks()]
    names = gathered[0][0]
    if not names:
        return None
    for name in shown.angles:
        if name not in names:
            raise OptionsError(f"--angle: no angle {name!r}. {suggestion(name, names)} There are {choices(names, 40)}.")
    degrees, sds = (np.concatenate([part[i] for part in gathered]) for i in (1, 2))
    chosen = [names.index(name) for name in shown.angles] or _moving(degrees)
    panels = [(f"{names[a]}, degrees", degrees[:, :, a]) for a in chosen]
    return lambda: _line_panels(shown, panels, np.arange(shown.result.n_frames), [sds[:, :, a] for a in chosen])


def _moving(degrees: np.ndarray) -> list[int]:
    """Places of the angles that range farthest, in their order."""
    ranges = []
    for a in range(degrees.shape[2]):
        known = degrees[:, :, a][np.isfinite(degrees[:, :, a])]
        ranges.append(float(np.subtract(*np.percentile(known, (95, 5)))) if len(known) else 0.0)
    return sorted(np.argsort(-np.array(ranges), kind="stable")[:_MOST_PANELS].tolist())


def _line_panels(
    shown: Shown,
    panels: Sequence[tuple[str, np.ndarray]],
    places: np.ndarray,
    bands: Sequence[np.ndarray] = (),
) -> Figure:
    """A panel for each title and values of shape (place, person), one above the other."""
    when, unit = _when(shown.result)
    figure = Figure(figsize=(_WIDTH_IN, 1.15 * len(panels) + 0.6), layout="constrained")
    grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for i, (axes, (title, values)) in enumerate(zip(grid, panels, strict=True)):
        for p, name in enumerate(shown.result.person_ids):
            colour = PEOPLE_COLOURS[p % len(PEOPLE_COLOURS)]
            axes.plot(
                when[places], values[:, p], color=colour, linestyle=_DASHES[p % len(_DASHES)], linewidth=0.9, label=name
            )
            if bands:
                low, high = values[:, p] - bands[i][:, p], values[:, p] + bands[i][:, p]
                axes.fill_between(when[places], low, high, color=colour, alpha=0.2, linewidth=0)
        axes.set_title(title)
        axes.set_xlim(when[0], when[-1] if when[-1] > when[0] else when[0] + 1)
    grid[-1].set_xlabel(unit)
    if len(shown.result.person_ids) > 1:
        grid[0].legend(
            frameon=False, ncols=5, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, fontsize=7
        )
    return figure


def _gaps(shown: Shown) -> _Drawing:
    """Where keypoints were measured, filled and missing, a panel a person."""
    starts = shown.series.starts()
    how = mostly(shown.series.how, starts)
    names = shown.result.person_ids[:_MOST_PANELS]

    def drawing() -> Figure:
        when, unit = _when(shown.result)
        figure = Figure(figsize=(_WIDTH_IN, len(names) * (0.12 * how.shape[2] + 0.5) + 0.5), layout="constrained")
        grid = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        edges = [when[0], when[-1] if when[-1] > when[0] else when[0] + 1, how.shape[2] - 0.5, -0.5]
        for p, axes in enumerate(grid):
            axes.imshow(
                how[:, p].T, cmap=ListedColormap(list(_HOW_COLOURS)), vmin=0, vmax=3, aspect="auto",
                interpolation="nearest", extent=edges,
            )  # fmt: skip
            axes.set_title(names[p])
            axes.set_yticks(range(how.shape[2]), shown.result.skeleton.keypoints, size=5)
            axes.tick_params(axis="y", length=0)
        for x, code, word in ((1.0, 0, "missing"), (0.88, FILLED, "filled or held"), (0.7, MEASURED, "measured")):
            text = (
                {"color": INK, "backgroundcolor": _HOW_COLOURS[code]}
                if code
                else {"color": "white", "backgroundcolor": _HOW_COLOURS[0]}
            )
            grid[0].text(x, 1.06, word, ha="right", size=7, transform=grid[0].transAxes, **text)
        grid[-1].set_xlabel(unit)
        return figure

    return drawing


def _lives(shown: Shown) -> _Drawing | None:
    """A line a person: thick while active, thin while tentative, dotted while lost."""
    tracks = shown.result.tracks
    if tracks is None:
        return None
    state = np.asarray(tracks.state[:])
    looks = {TrackState.ACTIVE: (5.0, "-"), TrackState.TENTATIVE: (1.5, "-"), TrackState.LOST: (1.5, (0, (1, 1)))}

    def drawing() -> Figure:
        when, unit = _when(shown.result)
        ends = np.append(when, when[-1] + (float(np.median(np.diff(when))) if len(when) > 1 else 1.0))
        names = shown.result.person_ids
        figure = Figure(figsize=(_WIDTH_IN, 0.24 * len(names) + 0.8), layout="constrained")
        axes = figure.subplots()
        for p in range(len(names)):
            cuts = [0, *(np.flatnonzero(np.diff(state[:, p])) + 1).tolist(), len(state)]
            for a, b in pairwise(cuts):
                if state[a, p] == TrackState.ABSENT:
                    continue
                width, dash = looks[TrackState(int(state[a, p]))]
                colour = PEOPLE_COLOURS[p % len(PEOPLE_COLOURS)]
                axes.plot(ends[[a, b]], [p, p], color=colour, linewidth=width, linestyle=dash, solid_capstyle="butt")
        for event in shown.result.events:
            if event.person in names and np.isfinite(event.time_s):
                at = event.time_s if unit == "s" else event.number
                axes.annotate(event.what, (at, names.index(event.person) - 0.2), size=6, color=INK, va="bottom")
        axes.set_yticks(range(len(names)), names, color=INK)
        axes.set(ylim=(len(names) - 0.5, -0.7), xlim=(ends[0], ends[-1]), xlabel=unit)
        axes.grid(axis="x", color=PALE, linewidth=0.5)
        return figure

    return drawing


def _when(result: Reconstruction) -> tuple[np.ndarray, str]:
    """Times of the frames in s, or their numbers where a time is unknown."""
    if np.isfinite(result.time_s).all():
        return result.time_s, "s"
    return result.frame_numbers.astype(np.float64), "frame"


FIGURES: dict[str, tuple[str, Callable[[Shown], _Drawing | None]]] = {
    "errors": ("reprojection error of each camera and keypoint", _errors),
    "shares": ("detections used, rejected and missing of each camera and keypoint", _shares),
    "time": ("reprojection error and views used over time", _time),
    "gaps": ("where each keypoint was measured, filled and missing", _gaps),
    "bones": ("lengths over time of the eight bones that vary most", _bones),
    "lives": ("when each person was tentative, active and lost", _lives),
    "trajectories": ("coordinates of --keypoint over time, with their standard deviations", _trajectories),
    "angles": ("joint angles over time: --angle, or the eight that range farthest", _angles),
}
"""Figures by name: what each shows, and how it is drawn."""
