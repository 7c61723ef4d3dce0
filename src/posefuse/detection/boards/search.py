"""Search a board in the images of a video: around the place where it was, else in an image of half the size.

Most images of a calibration show no board, and a board fills a small part of the others. Small markers are lost in a
reduced image; so a board that is not found where it was is searched in the whole image. Once no image has shown
the board for a third of a second, only one image in that time is examined; where it appears, those before are examined,
too.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from posefuse.detection.boards.detector import MIN_CORNERS, BoardDetector
from posefuse.detection.boards.library import dictionary_of, import_opencv

_REDUCED = 0.5
_WINDOW_PX = 11
_MARGIN = 0.35
_MIN_MARGIN_PX = 40
_WHOLE = 0.6
"""Share of an image above which the whole image is searched."""
_MAX_STEP_S, _MAX_WAITING = 0.35, 12
"""Longest time from one examined image to the next, and the most images between them; a board that is shown for less is
blurred or of little use. After a board that is missed in some images, for so long all images are examined."""


@dataclass
class BoardSearch:
    """Search of one board in the images of one video, in their order.

    Attributes:
        detector: detector of the board.
    """

    detector: BoardDetector
    _outline: np.ndarray | None = None
    _seen: bool = False
    _markers: Any = field(default=None, repr=False)

    def corners_of(self, images: Iterable[tuple[float, np.ndarray]]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield each image of a video with its corners, as :meth:`BoardDetector.corners_px` returns them.

        Args:
            images: times in s, and images of shape (height, width), uint8, in order.
        """
        waiting: list[np.ndarray] = []
        last_s = seen_s = float("-inf")
        n_missed = 0
        previous: tuple[float, np.ndarray] | None = None
        for time_s, gray in images:
            if previous is not None:
                # The previous image is the last one that is early enough, or the board was there shortly before.
                was_there = n_missed < _MAX_WAITING and previous[0] - seen_s <= _MAX_STEP_S
                if was_there or len(waiting) == _MAX_WAITING or not time_s - last_s <= _MAX_STEP_S:
                    yield from self._examine(waiting, previous[1])
                    waiting, last_s = [], previous[0]
                    seen_s, n_missed = (last_s, 0) if self._seen else (seen_s, n_missed + 1)
                else:
                    waiting.append(previous[1])
            previous = time_s, gray
        if previous is not None:
            yield from self._examine(waiting, previous[1])

    def _examine(self, waiting: list[np.ndarray], gray: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield images that were passed over and the one after them, with their corners."""
        found = self.corners_px(gray)
        outline, self._seen = self._outline, bool(np.isfinite(found).any())
        before = []
        for image in reversed(waiting):
            # Where the board leaves the images, seen backward, those before do not show it.
            shown = self._seen and (not before or np.isfinite(before[-1]).any())
            before.append(self.corners_px(image) if shown else np.full_like(found, np.nan))
        self._outline = outline
        yield from zip([*waiting, gray], [*reversed(before), found], strict=True)

    def corners_px(self, gray: np.ndarray) -> np.ndarray:
        """Return the corners found in the next image, as :meth:`BoardDetector.corners_px` does.

        Args:
            gray: shape (height, width), uint8.
        """
        if self.detector.board.kind == "checkerboard":
            return self.detector.corners_px(gray)
        found = np.full((len(self.detector.board.points_m), 2), np.nan)
        if self._outline is not None:
            found = self._around(gray, self._outline)
        elif self._shows_markers(gray):
            found = self.detector.corners_px(gray)
        self._outline = self._expected_outline(found)
        return found

    def _around(self, gray: np.ndarray, outline: np.ndarray) -> np.ndarray:
        """Return the corners in an image that showed the board in an outline before."""
        size = np.array(gray.shape[::-1])
        margin = max(_MARGIN * float(np.ptp(outline, axis=0).max()), _MIN_MARGIN_PX)
        low = np.clip(np.floor(outline.min(axis=0) - margin), 0, size).astype(int)
        high = np.clip(np.ceil(outline.max(axis=0) + margin), 0, size).astype(int)
        if np.prod(high - low) > _WHOLE * np.prod(size):
            return self.detector.corners_px(gray)
        found = low + self.detector.corners_px(np.ascontiguousarray(gray[low[1] : high[1], low[0] : high[0]]))
        now = self._expected_outline(found)
        if now is None:
            return self.detector.corners_px(gray)
        inside = (np.clip(now, 0, size) >= low).all() and (np.clip(now, 0, size) <= high).all()
        return found if inside else self.detector.corners_px(gray)

    def _expected_outline(self, found: np.ndarray) -> np.ndarray | None:
        """Return where the corners of the whole board are in the image, shape (4, 2); None if it was not found."""
        board = self.detector.board
        known = np.isfinite(found).all(axis=1)
        if known.sum() < MIN_CORNERS:
            return None
        points = board.points_m[:, :2]
        map_, _ = import_opencv().findHomography(points[known], found[known])
        edge = board.square_m
        low, high = points.min(axis=0) - edge, points.max(axis=0) + edge
        rectangle = np.array(
            [[low[0], low[1], 1.0], [high[0], low[1], 1.0], [high[0], high[1], 1.0], [low[0], high[1], 1.0]]
        )
        if map_ is None:
            return None
        mapped = rectangle @ map_.T
        if not (mapped[:, 2] * mapped[0, 2] > 0.0).all():
            return None
        return mapped[:, :2] / mapped[:, 2:]

    def _shows_markers(self, gray: np.ndarray) -> bool:
        """Return whether the image, reduced to half its size, shows markers of the board."""
        cv2, board = import_opencv(), self.detector.board
        if self._markers is None:
            parameters = cv2.aruco.DetectorParameters()
            parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = _WINDOW_PX
            self._markers = cv2.aruco.ArucoDetector(dictionary_of(board.dictionary, board.n_markers), parameters)
        small = cv2.resize(gray, None, fx=_REDUCED, fy=_REDUCED, interpolation=cv2.INTER_AREA)
        return len(self._markers.detectMarkers(255 - small if board.inverted else small)[0]) > 0
