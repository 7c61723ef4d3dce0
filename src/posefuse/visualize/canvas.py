"""Shapes that are collected first and painted on an image at once.

Pixel (0, 0) is the center of the top-left pixel.
"""

import numpy as np

from posefuse.visualize.colors import Color


class Shapes:
    """Lines, discs, rings, crosses and squares, in painting order."""

    def __init__(self) -> None:
        """Create an empty collection."""
        self._rows: list[tuple[float, ...]] = []

    def line(self, start: np.ndarray, end: np.ndarray, width_px: float, color: Color, opacity: float = 1.0) -> None:
        """Add a line with round ends from one (x, y) to another."""
        self._rows.append((*start, *end, 0.0, width_px / 2, *color, opacity))

    def disc(self, center: np.ndarray, radius_px: float, color: Color, opacity: float = 1.0) -> None:
        """Add a filled circle around (x, y)."""
        self._rows.append((*center, *center, 0.0, radius_px, *color, opacity))

    def ring(self, center: np.ndarray, radius_px: float, width_px: float, color: Color, opacity: float = 1.0) -> None:
        """Add a circle around (x, y)."""
        self._rows.append((*center, *center, radius_px, width_px / 2, *color, opacity))

    def cross(self, center: np.ndarray, radius_px: float, width_px: float, color: Color) -> None:
        """Add a diagonal cross around (x, y)."""
        for step in (np.array([radius_px, radius_px]), np.array([radius_px, -radius_px])):
            self.line(center - step, center + step, width_px, color)

    def square(self, center: np.ndarray, radius_px: float, width_px: float, color: Color) -> None:
        """Add the outline of a square around (x, y)."""
        corners = center + radius_px * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            self.line(start, end, width_px, color)

    def paint(self, image: np.ndarray) -> None:
        """Paint the shapes.

        Args:
            image: shape (height, width, 3), uint8, contiguous; modified in place.
        """
        from posefuse.kernels.visualize import paint  # imported late because kernels start the compiler

        paint.paint(image, np.array(self._rows, dtype=np.float64).reshape(-1, paint.COLUMNS))


def shade(image: np.ndarray, left: int, top: int, width: int, height: int, color: Color, opacity: float) -> None:
    """Blend a color over the part of a rectangle that is inside the image."""
    part = image[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)]
    part[...] = np.round(part + (np.array(color) - part) * opacity).astype(np.uint8)


def stamp(image: np.ndarray, mask: np.ndarray, left: int, top: int, color: Color) -> None:
    """Blend a color into an image through a mask.

    Args:
        image: shape (height, width, 3), uint8; modified in place.
        mask: shape (rows, columns), uint8: 255 where the color is opaque; may extend beyond the image.
        left: image column of the mask's first column.
        top: image row of the mask's first row.
        color: red, green, blue.
    """
    rows, columns = mask.shape
    x0, y0 = max(left, 0), max(top, 0)
    x1, y1 = min(left + columns, image.shape[1]), min(top + rows, image.shape[0])
    if x1 <= x0 or y1 <= y0:
        return
    cover = mask[y0 - top : y1 - top, x0 - left : x1 - left, None] / 255.0
    part = image[y0:y1, x0:x1]
    part[...] = np.round(part + (np.array(color) - part) * cover).astype(np.uint8)
