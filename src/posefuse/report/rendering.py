"""Rendering of figures to PNG and SVG: one style, no window, byte-identical for the same numbers."""

import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK = "#222222"
GRAY = "#888888"
PALE = "#cfcfcf"

_STYLE: Any = {
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": INK,
    "axes.edgecolor": GRAY,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK,
    "xtick.color": GRAY,
    "ytick.color": GRAY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.linewidth": 1.2,
    "savefig.dpi": 150,
    # Names come from files: a dollar sign in a name must not start math mode.
    "text.parse_math": False,
    "svg.hashsalt": "posefuse",
    "agg.path.chunksize": 10000,
    "figure.constrained_layout.w_pad": 0.08,
    "figure.constrained_layout.h_pad": 0.08,
}


@dataclass(frozen=True)
class RenderedFigure:
    """A figure as the contents of a PNG file and an SVG file."""

    png: bytes
    svg: bytes


def render_figure(draw: Callable[[], Figure]) -> RenderedFigure:
    """Draw a figure and render it, independently of the user's settings of the plotting library."""
    with matplotlib.rc_context(), warnings.catch_warnings():
        # A name in a script that the font lacks is drawn as boxes; the rest of the figure is still useful.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        matplotlib.rcdefaults()
        with matplotlib.rc_context(_STYLE):
            figure = draw()
            _freeze_layout(figure)
            return RenderedFigure(_save(figure, "png", {"Software": None}), _save(figure, "svg", {"Date": None}))


def _freeze_layout(figure: Figure) -> None:
    """Fix the rounded positions of the axes.

    The layout solver's result depends on memory addresses in its last digits.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        left, bottom, width, height = (round(value, 5) for value in axes.get_position(original=True).bounds)
        axes.set_position((left, bottom, width, height))


def _save(figure: Figure, form: str, metadata: dict[str, None]) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format=form, metadata=metadata)
    return file.getvalue()


def remove_frame(axes: Axes) -> None:
    """Remove spines and tick marks from axes with labeled bars or dots."""
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.tick_params(length=0)
