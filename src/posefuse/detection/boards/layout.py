"""Numbers of columns and rows of a board, from the arrangement of its markers or corners in an image."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from posefuse.detection.boards.library import dictionary_of, import_opencv
from posefuse.model.board import Board, marker_count

MAX_COLUMNS = 24
_MIN_MARKERS = 5
_SEARCHED_MARKERS = 100
FITS, _DOES_NOT_FIT = 0.06, 0.2
"""Root mean square distances of marker corners from a flat board, as shares of a marker's side."""

_MOST_SAMPLES = 50
"""Largest number of samples of four corners from which a board is fitted if some markers are not on it."""
_DRAWN_MARKER, _DRAWN_GAP = 0.5, 1.0


@dataclass(frozen=True)
class Layout:
    """The size of a board as an image shows it.

    Attributes:
        columns: number of columns.
        rows: least number of rows.
    """

    columns: int
    rows: int


def find_layout(board: Board, gray: np.ndarray) -> Layout | None:
    """Return the size of the board in an image, or None if the stated one fits or none does.

    Args:
        board: the stated board.
        gray: shape (height, width), uint8.
    """
    if board.kind == "checkerboard":
        return None
    cv2 = import_opencv()
    # Those of a board of twice the size; OpenCV compares every square shape with every marker.
    n_markers = max(_SEARCHED_MARKERS, 4 * board.n_markers)
    detector = cv2.aruco.ArucoDetector(dictionary_of(board.dictionary, n_markers))
    corners, numbers, _ = detector.detectMarkers(255 - gray if board.inverted else gray)
    if numbers is None or len(numbers) < _MIN_MARKERS:
        return None
    numbers, pixels = np.ravel(numbers), np.asarray(corners, dtype=np.float64).reshape(-1, 4, 2)
    stated = layout_misfit(cv2, board, board.columns, numbers, pixels)
    if stated < _DOES_NOT_FIT:
        rows = count_rows(board, board.columns, numbers)
        return Layout(board.columns, rows) if rows > board.rows else None
    others = {c: layout_misfit(cv2, board, c, numbers, pixels) for c in range(2, MAX_COLUMNS + 1) if c != board.columns}
    best = min(others, key=lambda c: others[c])
    return Layout(best, count_rows(board, best, numbers)) if others[best] < FITS else None


def count_rows(board: Board, columns: int, numbers: np.ndarray) -> int:
    """Return the least number of rows of a board that has some markers."""
    per_row = columns / 2 if board.kind == "charuco" else columns
    return int(np.ceil((int(numbers.max()) + 1) / per_row - 1e-9))


def layout_misfit(cv2: Any, board: Board, columns: int, numbers: np.ndarray, pixels: np.ndarray) -> float:
    """Return how far the markers are from those of a flat board with some columns, as a share of a marker's side."""
    error = _corner_errors(cv2, board, columns, numbers, pixels, robust=False)
    return float("inf") if error is None else float(np.sqrt(np.mean(error**2)))


def fitting_markers(cv2: Any, board: Board, columns: int, numbers: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return which markers are on a flat board with some columns, shape (marker,), bool.

    Patterns of a room that are taken for markers are not.
    """
    error = _corner_errors(cv2, board, columns, numbers, pixels, robust=True)
    if error is None:
        return np.zeros(len(numbers), dtype=bool)
    return np.asarray(error.max(axis=1) < 2.0 * FITS)


def _corner_errors(
    cv2: Any, board: Board, columns: int, numbers: np.ndarray, pixels: np.ndarray, *, robust: bool
) -> np.ndarray | None:
    """Return the distances of the corners from a flat board as shares of a marker's side, shape (marker, 4)."""
    places = _places(cv2, board, columns, int(numbers.max()))
    if places is None:
        return None
    flat, image = places[numbers].reshape(-1, 2), pixels.reshape(-1, 2)
    side = max(float(np.median(np.linalg.norm(np.diff(pixels, axis=1), axis=2))), 1e-9)
    if robust:
        found, _ = cv2.findHomography(flat, image, cv2.RANSAC, FITS * side, maxIters=_MOST_SAMPLES)
    else:
        found, _ = cv2.findHomography(flat, image, 0)
    if found is None:
        return None
    projected = np.concatenate([flat, np.ones((len(flat), 1))], axis=1) @ found.T
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.linalg.norm(projected[:, :2] / projected[:, 2:] - image, axis=1) / side
    return np.where(np.isfinite(error), error, np.inf).reshape(-1, 4)


def _places(cv2: Any, board: Board, columns: int, highest: int) -> np.ndarray | None:
    """Return the corners of markers on a board with some columns, shape (marker, 4, 2), or None if there are too many.

    The rows are as many as the markers need, even or odd as those stated: legacy boards depend on it.
    """
    dictionary, side = dictionary_of(board.dictionary), board.square_m
    per_row = columns / 2 if board.kind == "charuco" else columns
    rows = max(int(np.ceil((highest + 1) / per_row)), 2)
    rows += (rows - board.rows) % 2
    if int(columns * rows / (2 if board.kind == "charuco" else 1)) > marker_count(board.dictionary):
        return None
    # OpenCV warns of markers without a margin, so others are drawn and scaled.
    if board.kind == "charuco":
        pattern = cv2.aruco.CharucoBoard((columns, rows), side, side * _DRAWN_MARKER, dictionary)
        pattern.setLegacyPattern(board.legacy)
        corners = np.asarray(pattern.getObjPoints(), dtype=np.float64)[:, :, :2]
        centers = corners.mean(axis=1, keepdims=True)
        return centers + (corners - centers) * (board.marker / _DRAWN_MARKER)
    pattern = cv2.aruco.GridBoard((columns, rows), side, side * _DRAWN_GAP, dictionary)
    corners = np.asarray(pattern.getObjPoints(), dtype=np.float64)[:, :, :2]
    return corners - corners[:, :1] * ((_DRAWN_GAP - board.gap) / (1.0 + _DRAWN_GAP))
