"""Identify an unknown calibration board in images: its kind, its numbers of columns and rows, and its markers.

The side of its squares cannot be seen, so it is no part of the answer.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from posefuse.detection.boards.layout import FITS, MAX_COLUMNS, count_rows, fitting_markers, layout_misfit
from posefuse.detection.boards.library import dictionary_of, import_opencv
from posefuse.detection.boards.markers import MARKER_FAMILIES, MOST_MARKERS, smallest_dictionary
from posefuse.model.board import APRILTAG_DICTIONARIES, ARUCO_DICTIONARIES, Board, BoardKind

_MIN_MARKERS = 5
_LARGEST_PX = 1280
_CORNERS_PX = 960
_SEARCHED_SIDE, _SMALLEST_SIDE, _MIN_CORNERS = 3, 4, 20
"""Fewest inner corners of a checkerboard: 4 x 3 of them were found on a tiled floor."""
_MOST_FITTED = 3
_FITTING_SHARE = 0.7
"""Least share of an image's markers that are on the board."""
_MARKERS = (0.5, 0.6, 0.7, 0.75, 0.8, 0.9)
_GAPS = (0.1, 0.2, 0.3, 0.5, 1.0)
_ROUNDED = 0.021
"""Shares are rounded to the next multiple of 0.05 if it is nearer than this."""
_EVEN_ROWS, _ODD_ROWS = 6, 5


@dataclass(frozen=True)
class IdentifiedBoard:
    """A board that images show.

    Attributes:
        kind: charuco, checkerboard, aruco or apriltag.
        columns: number of columns, as in :class:`~posefuse.model.board.Board`.
        rows: least number of rows.
        dictionary: dictionary of its markers; empty for a checkerboard.
        inverted: whether black and white are swapped.
        legacy: whether it has the pattern of OpenCV before 4.6.
        share: side of a marker as a share of the square, or gap as a share of the marker; 0 for a checkerboard.
        n_images: number of images that show it.
    """

    kind: BoardKind
    columns: int
    rows: int
    dictionary: str = ""
    inverted: bool = False
    legacy: bool = False
    share: float = 0.0
    n_images: int = 1

    def spec(self, side: str) -> str:
        """Return the description of the board with the side of its squares or markers, such as ``30mm``."""
        words = [f"{self.kind}:{self.columns}x{self.rows}", f"square={side}"]
        if self.kind != "checkerboard":
            words += [f"{'marker' if self.kind == 'charuco' else 'gap'}={self.share:g}", f"dict={self.dictionary}"]
        return ",".join([*words, *(name for name in ("inverted", "legacy") if getattr(self, name))])

    def agrees_with(self, board: Board) -> bool:
        """Return whether a described board can be this one; rows that no image shows are no contradiction."""
        if self.kind != board.kind:
            return False
        if self.kind == "checkerboard":
            return sorted((self.columns, self.rows)) == sorted((board.columns, board.rows))
        return self.columns == board.columns and self.rows <= board.rows and self.inverted == board.inverted


def identify_board(grays: Sequence[np.ndarray]) -> IdentifiedBoard | None:
    """Return the board that some images show, or None if they show none.

    The size of a board of which every image shows a part may be too small.

    Args:
        grays: images, each of shape (height, width), uint8.
    """
    found = _identify_markers([_reduced(gray, _LARGEST_PX) for gray in grays])
    return found or _identify_checkerboard([_reduced(gray, _CORNERS_PX) for gray in grays])


def merged(boards: Sequence[IdentifiedBoard]) -> IdentifiedBoard | None:
    """Return the board that most images of several cameras show, with the most rows that one of them shows."""
    if not boards:
        return None
    best = max(boards, key=lambda each: (each.n_images, each.columns * each.rows))
    same = [each for each in boards if each.kind == best.kind and each.dictionary == best.dictionary]
    if best.kind == "checkerboard":
        best = max(same, key=lambda each: (each.columns * each.rows, each.n_images))
    else:
        same = [each for each in same if each.columns == best.columns]
    return replace(best, rows=max(best.rows, *(each.rows for each in same if each.columns == best.columns)),
                   n_images=sum(each.n_images for each in same))  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Markers:
    """Markers of one dictionary in one image."""

    numbers: np.ndarray
    corners_px: np.ndarray


def _identify_markers(images: Sequence[np.ndarray]) -> IdentifiedBoard | None:
    """Return the board of the dictionary with the most markers."""
    cv2 = import_opencv()
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector([dictionary_of(name, MOST_MARKERS) for name in MARKER_FAMILIES], parameters)
    found: dict[tuple[int, bool], list[_Markers]] = {}
    for image in images:
        for inverted in (False, True):
            corners, numbers, _, families = detector.detectMarkersMultiDict(255 - image if inverted else image)
            if numbers is None:
                continue
            pixels = np.asarray(corners, dtype=np.float64).reshape(-1, 4, 2)
            for family in set(np.ravel(families).tolist()):
                own = np.ravel(families) == family
                if own.sum() >= _MIN_MARKERS:
                    found.setdefault((family, inverted), []).append(_Markers(np.ravel(numbers)[own], pixels[own]))
    for (family, inverted), seen in sorted(found.items(), key=lambda item: -sum(len(m.numbers) for m in item[1])):
        board = _fit_layout(cv2, MARKER_FAMILIES[family], seen)
        if board is not None:
            return replace(board, inverted=inverted)
    return None


def _fit_layout(cv2: Any, family: str, seen: list[_Markers]) -> IdentifiedBoard | None:
    """Return the board on which the markers of all images are flat, or None."""
    most = sorted(seen, key=lambda markers: -len(markers.numbers))[:_MOST_FITTED]

    def misfit(board: Board, columns: int) -> float:
        return float(np.mean([layout_misfit(cv2, board, columns, m.numbers, m.corners_px) for m in most]))

    def n_fitting(board: Board, columns: int) -> int:
        return int(fitting_markers(cv2, board, columns, most[0].numbers, most[0].corners_px).sum())

    candidates = [(board, columns) for board in _candidates(family) for columns in range(2, MAX_COLUMNS + 1)]
    best, columns = min(candidates, key=lambda each: misfit(*each))
    if not misfit(best, columns) < FITS:
        # A pattern of the room may be taken for a marker.
        best, columns = max(candidates, key=lambda each: n_fitting(*each))
    fitting = [(m, fitting_markers(cv2, best, columns, m.numbers, m.corners_px)) for m in seen]
    seen = [_Markers(m.numbers[own], m.corners_px[own]) for m, own in fitting if own.sum() >= _least_fitting(m)]
    if not seen:
        return None
    most = sorted(seen, key=lambda markers: -len(markers.numbers))[:_MOST_FITTED]
    if not misfit(best, columns) < FITS:
        return None
    shares = [round(0.01 * hundredth, 2) for hundredth in range(5, 100 if best.kind == "charuco" else 200)]
    share = min(shares, key=lambda value: misfit(_with_share(best, value), columns))
    usual = round(20.0 * share) / 20.0
    share = usual if abs(usual - share) < _ROUNDED else share
    highest = max(int(markers.numbers.max()) for markers in seen)
    rows = max(count_rows(best, columns, np.array([highest])), 2 if best.kind == "charuco" else 1)
    rows += rows % 2 if best.legacy else 0
    dictionary = smallest_dictionary(family, max(highest, columns * rows // 2 - 1))
    return IdentifiedBoard(best.kind, columns, rows, dictionary, legacy=best.legacy, share=share, n_images=len(seen))


def _least_fitting(markers: _Markers) -> int:
    """Return how many markers of an image are on the board, if it shows one."""
    return max(_MIN_MARKERS, round(_FITTING_SHARE * len(markers.numbers)))


def _candidates(family: str) -> list[Board]:
    """Return one board of each kind of layout; the pattern of a legacy board differs if its number of rows is even."""
    grid = "apriltag" if family in APRILTAG_DICTIONARIES else "aruco"
    charuco = [
        Board("charuco", 4, _EVEN_ROWS if legacy else _ODD_ROWS, 1.0, marker, dictionary=family, legacy=legacy)
        for legacy in (False, True)
        for marker in _MARKERS
        if family in ARUCO_DICTIONARIES or not legacy
    ]
    return [*charuco, *(Board(grid, 3, 3, 1.0, gap=gap, dictionary=family) for gap in _GAPS)]


def _with_share(board: Board, share: float) -> Board:
    return replace(board, marker=share) if board.kind == "charuco" else replace(board, gap=share)


def _identify_checkerboard(images: Sequence[np.ndarray]) -> IdentifiedBoard | None:
    """Return the largest checkerboard that several images show, or the only one.

    OpenCV's sector-based detector extends a small pattern as far as it continues.
    """
    cv2 = import_opencv()
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    sizes: Counter[tuple[int, int]] = Counter()
    for image in images:
        found, _, pattern = cv2.findChessboardCornersSBWithMeta(image, (_SEARCHED_SIDE, _SEARCHED_SIDE), flags)
        if found and pattern.size >= _MIN_CORNERS and min(pattern.shape) >= _SMALLEST_SIDE:
            short, long = sorted(pattern.shape)
            sizes[short, long] += 1
    if not sizes:
        return None
    repeated = [size for size, count in sizes.items() if count > 1] or list(sizes)
    short, long = max(repeated, key=lambda size: size[0] * size[1])
    return IdentifiedBoard("checkerboard", long, short, n_images=sizes.total())


def _reduced(gray: np.ndarray, largest_px: int) -> np.ndarray:
    """Return an image whose longer side is not larger than stated."""
    factor = largest_px / max(gray.shape)
    if factor >= 1.0:
        return np.ascontiguousarray(gray)
    cv2 = import_opencv()
    return cv2.resize(gray, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
