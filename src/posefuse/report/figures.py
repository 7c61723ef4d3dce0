"""Figures as PNG and SVG: one look, no window, the same bytes for the same numbers."""

import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Okabe and Ito's colours: told apart by colour-blind people, and by their lightness in print.
BLUE = "#0072b2"
ORANGE = "#d55e00"
INK = "#222222"
GREY = "#888888"
PALE = "#cfcfcf"

_STYLE: Any = {
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.linewidth": 1.2,
    "savefig.dpi": 150,
    # Names come from files; a dollar sign in one is a dollar sign.
    "text.parse_math": False,
    "svg.hashsalt": "posefuse",
    "agg.path.chunksize": 10000,
    "figure.constrained_layout.w_pad": 0.08,
    "figure.constrained_layout.h_pad": 0.08,
}


@dataclass(frozen=True)
class Picture:
    """A figure as the contents of two files."""

    png: bytes
    svg: bytes


def picture(draw: Callable[[], Figure]) -> Picture:
    """Draw a figure and render it, whatever the user's own settings of the plotting library are."""
    with matplotlib.rc_context(), warnings.catch_warnings():
        # A name in a script the font lacks is drawn as boxes, and the numbers are there all the same.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        matplotlib.rcdefaults()
        with matplotlib.rc_context(_STYLE):
            figure = draw()
            _settle_layout(figure)
            return Picture(_rendered(figure, "png", {"Software": None}), _rendered(figure, "svg", {"Date": None}))


def _settle_layout(figure: Figure) -> None:
    """Fix where the axes are, rounded: the layout's solver goes by addresses in memory, which move the last digits."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        left, bottom, width, height = (round(value, 5) for value in axes.get_position(original=True).bounds)
        axes.set_position((left, bottom, width, height))


def _rendered(figure: Figure, form: str, metadata: dict[str, None]) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format=form, metadata=metadata)
    return file.getvalue()


def bare(axes: Axes) -> None:
    """Leave the axes without the lines and ticks that labelled bars and dots do not need."""
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.tick_params(length=0)
