"""Calibration boards: a flat pattern whose corners have known positions."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import frozen
from posefuse.errors import CalibrationError, choices, suggestion
from posefuse.skeleton.skeletons import Skeleton

BoardKind = Literal["charuco", "checkerboard", "aruco", "apriltag"]
BOARD_KINDS: tuple[BoardKind, ...] = get_args(BoardKind)

_FAMILIES = {"4X4": 16, "5X5": 25, "6X6": 36, "7X7": 49}
_SIZES = (50, 100, 250, 1000)
ARUCO_DICTIONARIES = (*(f"{family}_{size}" for family in _FAMILIES for size in _SIZES), "ARUCO_ORIGINAL")
APRILTAG_DICTIONARIES = ("APRILTAG_16h5", "APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11")
_MOST = 100
_DEFAULT_DICTIONARY = {"charuco": "4X4_50", "aruco": "4X4_50", "apriltag": "APRILTAG_36h11", "checkerboard": ""}


@checked
@dataclass(frozen=True)
class Board:
    """A calibration board.

    Its coordinate system has its origin at the first corner, x along the columns, y along the rows and z away from the
    viewer, as OpenCV's.

    Attributes:
        kind: charuco, checkerboard, aruco (grid of ArUco markers) or apriltag (grid of AprilTags).
        columns: number of squares (charuco), inner corners (checkerboard, as in OpenCV) or markers (grids) in a row.
        rows: number of them in a column.
        square_m: side of a square, or of a marker of a grid, in meters.
        marker: side of a marker as a share of the square (charuco).
        gap: distance between markers as a share of their side (grids).
        dictionary: name of OpenCV's dictionary of markers, such as ``4X4_250``; empty for a checkerboard.
        inverted: whether black and white are swapped.
        legacy: whether a ChArUco board has the pattern of OpenCV before 4.6, which differs if the number of rows is
            even.

    Raises:
        CalibrationError: if a value is impossible for a board.
    """

    kind: BoardKind
    columns: int
    rows: int
    square_m: float
    marker: float = 0.75
    gap: float = 0.2
    dictionary: str = ""
    inverted: bool = False
    legacy: bool = False

    def __post_init__(self) -> None:
        if self.kind not in BOARD_KINDS:
            raise CalibrationError(f"A board has no kind {self.kind!r}. Choose one of: {choices(BOARD_KINDS)}.")
        fewest = {"charuco": 2, "checkerboard": 2, "aruco": 1, "apriltag": 1}[self.kind]
        sizes = (self.columns, self.rows)
        if min(sizes) < fewest or max(sizes) > _MOST or self.columns * self.rows < 2:
            raise CalibrationError(
                f"A board of kind {self.kind!r} has {fewest} to {_MOST} columns and rows and more than one cell, got "
                f"{self.columns} x {self.rows}."
            )
        for name, value, most in (
            ("square_m", self.square_m, 10.0),
            ("marker", self.marker, 1.0),
            ("gap", self.gap, 10.0),
        ):
            if not 0.0 < value < most:
                what, unit = ("square", " m") if name == "square_m" else (name, "")
                raise CalibrationError(
                    f"{what} of a board must be above 0 and below {most:g}{unit}, got {value:g}{unit}."
                )
        if self.kind == "checkerboard":
            object.__setattr__(self, "dictionary", "")
            return
        known = APRILTAG_DICTIONARIES if self.kind == "apriltag" else (*ARUCO_DICTIONARIES, *APRILTAG_DICTIONARIES)
        name = (self.dictionary or _DEFAULT_DICTIONARY[self.kind]).removeprefix("DICT_")
        if name not in known:
            raise CalibrationError(f"No dictionary of markers {name!r}. {suggestion(name, known)}")
        object.__setattr__(self, "dictionary", name)
        if self.n_markers > marker_count(name):
            raise CalibrationError(
                f"The board has {self.n_markers} markers, but the dictionary {name} has {marker_count(name)}. "
                "Choose a larger dictionary or a smaller board."
            )

    @property
    def n_markers(self) -> int:
        """Number of markers on the board."""
        if self.kind == "checkerboard":
            return 0
        return self.columns * self.rows // 2 if self.kind == "charuco" else self.columns * self.rows

    @cached_property
    def points_m(self) -> np.ndarray:
        """Positions of the corners on the board, shape (corner, 3), in meters; z is 0.

        The corners of a grid of markers are those of each marker: top left, top right, bottom right, bottom left.
        """
        if self.kind in ("charuco", "checkerboard"):
            edge = 1 if self.kind == "charuco" else 0
            x, y = np.meshgrid(np.arange(self.columns - edge), np.arange(self.rows - edge))
            flat = np.stack([x.ravel(), y.ravel()], axis=1) + edge
            flat = flat * self.square_m
        else:
            x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
            first = np.stack([x.ravel(), y.ravel()], axis=1) * self.square_m * (1.0 + self.gap)
            corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * self.square_m
            flat = (first[:, None] + corners).reshape(-1, 2)
        return frozen(np.concatenate([flat, np.zeros((len(flat), 1))], axis=1))

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the printed pattern, in meters."""
        if self.kind in ("charuco", "checkerboard"):
            edge = 0 if self.kind == "charuco" else 1
            return (self.columns + edge) * self.square_m, (self.rows + edge) * self.square_m
        return tuple(n * self.square_m + (n - 1) * self.gap * self.square_m for n in (self.columns, self.rows))  # type: ignore[return-value]

    @cached_property
    def skeleton(self) -> Skeleton:
        """The corners as keypoints of a rigid subject."""
        return Skeleton("board", tuple(f"corner_{i}" for i in range(len(self.points_m))))

    def __str__(self) -> str:
        words = [f"{self.kind}:{self.columns}x{self.rows}", f"square={1000 * self.square_m:g}mm"]
        if self.kind == "charuco":
            words.append(f"marker={self.marker:g}")
        if self.kind in ("aruco", "apriltag"):
            words.append(f"gap={self.gap:g}")
        if self.dictionary:
            words.append(f"dict={self.dictionary}")
        words += [name for name in ("inverted", "legacy") if getattr(self, name)]
        return ",".join(words)


def marker_count(dictionary: str) -> int:
    """Return the number of markers of a dictionary."""
    sizes = {"ARUCO_ORIGINAL": 1024, "16h5": 30, "25h9": 35, "36h10": 2320, "36h11": 587}
    return sizes.get(dictionary.removeprefix("APRILTAG_")) or int(dictionary.rsplit("_", 1)[1])
