"""What is wrong with a board that the images do not show: another dictionary or size, mirrored images."""

from collections.abc import Iterator, Sequence
from itertools import zip_longest

import numpy as np

from posefuse.detection.boards.identify import identify_board
from posefuse.detection.boards.layout import Layout, find_layout
from posefuse.detection.boards.markers import MarkersFound, identify_markers
from posefuse.errors import CalibrationError
from posefuse.io.board_images import ImageReader, ViewImages, image_count
from posefuse.model.board import Board

_N_EXAMPLES = 6
_N_CHECKED = 4
_N_AT_ONCE = 8


def explain_missing_board(views: Sequence[ViewImages], board: Board) -> str:
    """Return why no image shows the board, from what the images contain instead."""
    text = f"No image shows the board {board}."
    examples = [list(_examples(view)) for view in views]
    # The images of all cameras in turn, because the first ones usually suffice.
    images = [gray for together in zip_longest(*examples) for gray in together if gray is not None]
    if board.kind == "checkerboard":
        found = _other_board(board, images)
        if found is not None:
            return f"{text} {found}"
        return (
            f"{text} Check its numbers of columns and rows (inner corners, one fewer than squares), and that it is "
            "flat, sharp and well lit."
        )
    other = identify_markers(images)
    if other is not None:
        best = [images[k] for k in other.images[:_N_CHECKED]]
        return f"{text} {_difference(other, board, best)}"
    return f"{text} Check its numbers of columns and rows and its dictionary, and that it is flat, sharp and well lit."


def _other_board(board: Board, images: list[np.ndarray]) -> str | None:
    """Return which board some images show instead of a checkerboard, or None."""
    batches = (images[k : k + _N_AT_ONCE] for k in range(0, len(images), _N_AT_ONCE))
    other = next((found for batch in batches if (found := identify_board(batch)) is not None), None)
    if other is None or other.agrees_with(board):
        return None
    if other.kind != "checkerboard":
        return f"The images show another board: write {other.spec('30mm')} with the side that you measure."
    columns, rows = (other.columns, other.rows) if board.columns >= board.rows else (other.rows, other.columns)
    return (
        f"The images show a checkerboard of {columns} x {rows} inner corners, "
        f"{_more(Layout(columns, rows), board)} than stated: write checkerboard:{columns}x{rows}."
    )


def require_stated_board(layouts: Sequence[Layout | None], board: Board) -> None:
    """Check that the board in the images has the stated number of columns and rows.

    Args:
        layouts: for each camera, the size of the board where it differs from the stated one.
        board: the stated board.

    Raises:
        CalibrationError: if the markers are arranged otherwise in the images.
    """
    layout = next((each for each in layouts if each is not None), None)
    if layout is not None:
        raise CalibrationError(f"The board {board} does not fit the images. {_size(layout, board)}")


def _examples(view: ViewImages) -> Iterator[np.ndarray]:
    """Yield some images of a camera, spread over its video or folder."""
    wanted = np.unique(np.linspace(0, image_count(view) - 1, _N_EXAMPLES).round().astype(np.int64))
    for image in ImageReader(view).images(frozenset(wanted.tolist()).__contains__):
        yield image.gray


def _difference(other: MarkersFound, board: Board, images: list[np.ndarray]) -> str:
    """Return how the markers of the images differ from those of the board."""
    if other.mirrored:
        return "The images are mirrored: turn off the mirroring of the camera and film the board again."
    if other.dictionary != board.dictionary and not _begins(board.dictionary, other.dictionary):
        return f"The images contain markers of the dictionary {other.dictionary}: write dict={other.dictionary}."
    if other.inverted != board.inverted:
        return "Black and white are swapped in the images: " + (
            "add inverted to the board." if other.inverted else "remove inverted from the board."
        )
    layout = next((found for gray in images if (found := find_layout(board, gray)) is not None), None)
    if layout is not None:
        return _size(layout, board)
    return (
        f"The images contain {other.n_markers} markers of its dictionary, up to number {other.highest}: check the "
        "numbers of columns and rows, and whether the pattern is legacy."
    )


def _begins(stated: str, found: str) -> bool:
    """Return whether a found dictionary is the beginning of the stated, larger one."""
    family, _, size = stated.rpartition("_")
    other_family, _, other_size = found.rpartition("_")
    return family == other_family and size.isdigit() and other_size.isdigit() and int(other_size) <= int(size)


def _size(layout: Layout, board: Board) -> str:
    """Return the size of the board in the images."""
    unit = "squares" if board.kind == "charuco" else "markers"
    if layout.columns == board.rows and layout.rows <= board.columns:
        return (
            f"The images show {layout.columns} columns and at least {layout.rows} rows of {unit}: columns come before "
            f"rows, write {board.kind}:{board.rows}x{board.columns}."
        )
    rows = max(layout.rows, 2 if board.kind == "charuco" else 1)
    return (
        f"The images show a board with {_more(layout, board)} {unit} than stated, {layout.columns} columns and at "
        f"least {rows} rows: write {board.kind}:{layout.columns}x{rows}, or the number of rows that you count."
    )


def _more(layout: Layout, board: Board) -> str:
    """Return whether a board has more or fewer cells than stated."""
    if layout.columns != board.columns:
        return "more" if layout.columns > board.columns else "fewer"
    return "more" if layout.rows > board.rows else "fewer"
