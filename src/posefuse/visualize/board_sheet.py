"""Draw a calibration board to print, in its true size, as PDF or SVG."""

from pathlib import Path
from typing import Any

import numpy as np

from posefuse.detection.boards.library import dictionary_of
from posefuse.errors import FileError, choices
from posefuse.io.files import replacing
from posefuse.model.board import Board

ENDINGS = (".pdf", ".svg")
_MARGIN_M = 0.012
_METERS_PER_INCH = 0.0254
_RULER_M = 0.1


def black_squares(board: Board) -> np.ndarray:
    """Return the black rectangles of a board, shape (rectangle, 4): left, top, width, height in meters.

    The origin is the top left corner of the printed pattern, y down. Black is white on an inverted board.
    """
    if board.kind == "checkerboard":
        return _squares(board.columns + 1, board.rows + 1, board.square_m, odd=0)
    if board.kind in ("aruco", "apriltag"):
        step = board.square_m * (1.0 + board.gap)
        places = [(c * step, r * step) for r in range(board.rows) for c in range(board.columns)]
        return np.concatenate([_marker(board, k, place, board.square_m) for k, place in enumerate(places)])
    first = 1 if board.legacy and board.rows % 2 == 0 else 0
    parts = [_squares(board.columns, board.rows, board.square_m, odd=first)]
    side = board.marker * board.square_m
    inset = 0.5 * (board.square_m - side)
    number = 0
    for r in range(board.rows):
        for c in range(board.columns):
            if (r + c) % 2 != first:
                place = (c * board.square_m + inset, r * board.square_m + inset)
                parts.append(_marker(board, number, place, side))
                number += 1
    return np.concatenate(parts)


def _squares(columns: int, rows: int, side: float, *, odd: int) -> np.ndarray:
    """Return the black squares of a checkerboard."""
    places = [(c, r) for r in range(rows) for c in range(columns) if (r + c) % 2 == odd]
    return np.array([[c * side, r * side, side, side] for c, r in places])


def _marker(board: Board, number: int, place: tuple[float, float], side: float) -> np.ndarray:
    """Return the black cells of a marker, joined along its rows."""
    dictionary = dictionary_of(board.dictionary)
    n = dictionary.markerSize + 2
    black = dictionary.generateImageMarker(number, n) == 0
    cell = side / n
    out = []
    for r in range(n):
        c = 0
        while c < n:
            start = c
            while c < n and black[r, c]:
                c += 1
            if c > start:
                out.append([place[0] + start * cell, place[1] + r * cell, (c - start) * cell, cell])
            c += 1
    return np.array(out)


def write_board(board: Board, path: Path) -> None:
    """Draw a board as PDF or SVG in its true size, with its size written on it and a ruler to check the print.

    Raises:
        FileError: if the name ends in neither .pdf nor .svg, or OpenCV or matplotlib is not installed.
    """
    if path.suffix.lower() not in ENDINGS:
        raise FileError(f"{path}: the name of a board must end in {choices(ENDINGS)}.")
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise FileError(
            "Drawing boards needs matplotlib, which is not installed. Run: pip install 'posefuse[calibrate]'."
        ) from None
    width, height = board.size_m
    page = np.array([width + 2 * _MARGIN_M, height + 3.5 * _MARGIN_M])
    figure = Figure(figsize=tuple(page / _METERS_PER_INCH))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(-_MARGIN_M, width + _MARGIN_M), ylim=(height + 2.5 * _MARGIN_M, -_MARGIN_M))
    axes.set_axis_off()
    if board.inverted:
        _rectangles(axes, np.array([[-_MARGIN_M, -_MARGIN_M, width + 2 * _MARGIN_M, height + 2 * _MARGIN_M]]), "black")
    _rectangles(axes, black_squares(board), "white" if board.inverted else "black")
    _caption(axes, board, height + 1.3 * _MARGIN_M)
    metadata: dict[str, Any] = {"Date": None} if path.suffix.lower() == ".svg" else {"CreationDate": None}
    from matplotlib import rc_context

    with replacing(path) as temporary, rc_context({"svg.hashsalt": "posefuse", "pdf.compression": 9}):
        figure.savefig(temporary, format=path.suffix[1:].lower(), metadata=metadata)


def _rectangles(axes: Any, rectangles: np.ndarray, color: str) -> None:
    """Draw filled rectangles without gaps between neighbors."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    patches = [Rectangle((x, y), w, h) for x, y, w, h in rectangles]
    axes.add_collection(PatchCollection(patches, facecolor=color, edgecolor="none", antialiased=False))


def _caption(axes: Any, board: Board, top: float) -> None:
    """Write the description of the board and draw a ruler."""
    from matplotlib.patches import Rectangle

    length = min(_RULER_M, np.floor(board.size_m[0] * 100.0) / 100.0)
    axes.add_patch(Rectangle((0.0, top), length, 0.0006, facecolor="black", edgecolor="none"))
    for at in (0.0, length):
        axes.add_patch(Rectangle((at - 0.0002, top - 0.001), 0.0004, 0.0026, facecolor="black", edgecolor="none"))
    text = f"{1000 * length:.0f} mm when printed at 100 %   {board}"
    axes.text(0.0, top + 0.003, text, fontsize=7, va="top", ha="left")
