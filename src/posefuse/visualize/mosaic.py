"""Mosaics of the images of several cameras."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.visualize.colors import BACKGROUND
from posefuse.visualize.pillow_extra import require_pillow

_MAX_WIDTH_PX, _MAX_HEIGHT_PX = 1920, 1440


@dataclass(frozen=True)
class Mosaic:
    """Layout of the images of several cameras.

    Attributes:
        columns: number of columns.
        rows: number of rows.
        tile_px: width and height of a tile.
        sizes_px: size of each image, scaled to fit its tile.
    """

    columns: int
    rows: int
    tile_px: tuple[int, int]
    sizes_px: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, sizes_px: Sequence[tuple[int, int]]) -> "Mosaic":
        """Return a mosaic of at most 1920 x 1440 px for images of these sizes; images are never enlarged."""
        columns = math.ceil(math.sqrt(len(sizes_px)))
        rows = -(-len(sizes_px) // columns)
        width, height = (max(size[axis] for size in sizes_px) for axis in (0, 1))
        scale = min(1.0, _MAX_WIDTH_PX / (columns * width), _MAX_HEIGHT_PX / (rows * height))
        tile = (max(2, int(width * scale) // 2 * 2), max(2, int(height * scale) // 2 * 2))
        return cls(columns, rows, tile, tuple(_fit(size, tile) for size in sizes_px))

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the mosaic."""
        return self.columns * self.tile_px[0], self.rows * self.tile_px[1]

    def empty(self) -> np.ndarray:
        """Return the mosaic without images, shape (height, width, 3), uint8."""
        width, height = self.size_px
        return np.full((height, width, 3), BACKGROUND, dtype=np.uint8)

    def paste(self, canvas: np.ndarray, index: int, image: np.ndarray) -> None:
        """Copy an image to the center of its tile.

        Args:
            canvas: shape (height, width, 3), uint8; modified in place.
            index: index of the image.
            image: the image, of the size ``sizes_px[index]``.
        """
        row, column = divmod(index, self.columns)
        (width, height), (tile_width, tile_height) = self.sizes_px[index], self.tile_px
        left = column * tile_width + (tile_width - width) // 2
        top = row * tile_height + (tile_height - height) // 2
        canvas[top : top + height, left : left + width] = image


def resize_image(image: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """Return a resized copy of an image of shape (height, width, 3), uint8.

    Raises:
        ResultError: if the size differs and Pillow is not installed.
    """
    if (image.shape[1], image.shape[0]) == size_px:
        return image.copy()
    require_pillow()
    from PIL import Image

    return np.array(Image.fromarray(image).resize(size_px, Image.Resampling.BILINEAR))


def _fit(size: tuple[int, int], tile: tuple[int, int]) -> tuple[int, int]:
    scale = min(tile[0] / size[0], tile[1] / size[1])
    return max(1, min(tile[0], round(size[0] * scale))), max(1, min(tile[1], round(size[1] * scale)))
