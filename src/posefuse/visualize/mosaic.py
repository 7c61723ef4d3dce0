"""Pictures of several cameras side by side."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from posefuse.visualize.colors import BACKGROUND

_WIDEST_PX, _HIGHEST_PX = 1920, 1440


@dataclass(frozen=True)
class Board:
    """Where each camera's picture stands.

    Attributes:
        columns: pictures side by side.
        rows: pictures one above the other.
        tile_px: width and height of the room for one.
        sizes_px: of each picture, scaled to fit its room.
    """

    columns: int
    rows: int
    tile_px: tuple[int, int]
    sizes_px: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, sizes_px: Sequence[tuple[int, int]]) -> "Board":
        """A board for pictures of these sizes, at most 1920 x 1440 px, none made larger."""
        columns = math.ceil(math.sqrt(len(sizes_px)))
        rows = -(-len(sizes_px) // columns)
        widest, highest = (max(size[axis] for size in sizes_px) for axis in (0, 1))
        scale = min(1.0, _WIDEST_PX / (columns * widest), _HIGHEST_PX / (rows * highest))
        tile = (max(2, int(widest * scale) // 2 * 2), max(2, int(highest * scale) // 2 * 2))
        return cls(columns, rows, tile, tuple(_fitting(size, tile) for size in sizes_px))

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the whole."""
        return self.columns * self.tile_px[0], self.rows * self.tile_px[1]

    def empty(self) -> np.ndarray:
        """The board without pictures, shape (height, width, 3), uint8."""
        width, height = self.size_px
        return np.full((height, width, 3), BACKGROUND, dtype=np.uint8)

    def put(self, board: np.ndarray, place: int, picture: np.ndarray) -> None:
        """Lay a picture in the middle of its room.

        Args:
            board: shape (height, width, 3), uint8; drawn on.
            place: of the picture.
            picture: of the size that the board has for it.
        """
        row, column = divmod(place, self.columns)
        (width, height), (wide, high) = self.sizes_px[place], self.tile_px
        left, top = column * wide + (wide - width) // 2, row * high + (high - height) // 2
        board[top : top + height, left : left + width] = picture


def resized(picture: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """A copy of a picture, shape (height, width, 3), uint8, at another size."""
    if (picture.shape[1], picture.shape[0]) == size_px:
        return picture.copy()
    return np.array(Image.fromarray(picture).resize(size_px, Image.Resampling.BILINEAR))


def _fitting(size: tuple[int, int], room: tuple[int, int]) -> tuple[int, int]:
    scale = min(room[0] / size[0], room[1] / size[1])
    return max(1, min(room[0], round(size[0] * scale))), max(1, min(room[1], round(size[1] * scale)))
