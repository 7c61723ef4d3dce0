"""Detect the corners of a calibration board in an image.

ChArUco boards and grids of markers identify their corners, so a partly hidden board gives those that are visible. A
checkerboard is found whole or not at all. Corners are refined to a fraction of a pixel.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from posefuse.detection.boards.library import dictionary_of, import_opencv
from posefuse.model.board import Board

MIN_CORNERS = 4
"""Fewest corners of an image that are used."""
_REFINE_SHARE = 0.35
_REFINE_HALF_PX = (2, 15)
_REFINE_STEPS = 30
_REFINE_PX = 1e-3


@dataclass(frozen=True)
class BoardDetector:
    """Detector of one board; OpenCV's objects are made on first use, so that it can be sent to other processes.

    Attributes:
        board: the board.
        thorough: whether to search pictures, of which every one counts, longer than the frames of a video.
    """

    board: Board
    thorough: bool = False

    @cached_property
    def _detect(self) -> Any:
        return {
            "charuco": self._charuco,
            "checkerboard": self._checkerboard,
            "aruco": self._markers,
            "apriltag": self._markers,
        }[self.board.kind]

    @property
    def library_version(self) -> str:
        """Version of OpenCV."""
        return import_opencv().__version__

    def __getstate__(self) -> dict[str, Any]:
        return {"board": self.board, "thorough": self.thorough}

    def corners_px(self, gray: np.ndarray) -> np.ndarray:
        """Return the corners found in an image.

        Args:
            gray: shape (height, width), uint8.

        Returns:
            Shape (corner, 2) in px, NaN for corners that were not found.
        """
        out = np.full((len(self.board.points_m), 2), np.nan)
        numbers, pixels = self._detect(255 - gray if self.board.inverted else gray)
        if len(numbers) >= MIN_CORNERS:
            out[numbers] = pixels
        return out

    @cached_property
    def _charuco_detector(self) -> Any:
        cv2 = import_opencv()
        board = self.board
        pattern = cv2.aruco.CharucoBoard(
            (board.columns, board.rows),
            board.square_m,
            board.square_m * board.marker,
            dictionary_of(board.dictionary, board.n_markers),
        )
        pattern.setLegacyPattern(board.legacy)
        return cv2.aruco.CharucoDetector(pattern)

    def _charuco(self, gray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pixels, numbers, _, _ = self._charuco_detector.detectBoard(gray)
        return _found(numbers, pixels)

    @cached_property
    def _marker_detector(self) -> Any:
        cv2 = import_opencv()
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        return cv2.aruco.ArucoDetector(dictionary_of(self.board.dictionary, self.board.n_markers), parameters)

    def _markers(self, gray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        corners, numbers, _ = self._marker_detector.detectMarkers(gray)
        if numbers is None:
            return _found(None, None)
        markers = np.ravel(numbers)
        known = markers < self.board.n_markers
        pixels = np.array(corners, dtype=np.float64).reshape(-1, 4, 2)[known]
        return (4 * markers[known][:, None] + np.arange(4)).ravel(), pixels.reshape(-1, 2)

    def _checkerboard(self, gray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        cv2 = import_opencv()
        size = (self.board.columns, self.board.rows)
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, pixels = cv2.findChessboardCorners(
            gray, size, flags=flags if self.thorough else flags | cv2.CALIB_CB_FAST_CHECK
        )
        if not found and self.thorough:
            flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
            found, pixels = cv2.findChessboardCornersSB(gray, size, flags=flags)
        if not found:
            return _found(None, None)
        grid = np.asarray(pixels, dtype=np.float32).reshape(self.board.rows, self.board.columns, 2)
        # A window that contains no other corner.
        spacing = min(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1))
        half = int(np.clip(_REFINE_SHARE * spacing, _REFINE_HALF_PX[0], _REFINE_HALF_PX[1]))
        stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, _REFINE_STEPS, _REFINE_PX)
        refined = cv2.cornerSubPix(gray, grid.reshape(-1, 1, 2).copy(), (half, half), (-1, -1), stop)
        return _found(np.arange(len(self.board.points_m)), refined)


def _found(numbers: Any, pixels: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers of corners and their pixels; empty where nothing was found."""
    if numbers is None or len(numbers) == 0:
        return np.empty(0, dtype=np.int64), np.empty((0, 2))
    return np.ravel(numbers).astype(np.int64), np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
