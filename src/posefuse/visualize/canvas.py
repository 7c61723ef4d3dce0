"""Shapes to be painted on a picture, gathered first and painted at once.

Pixel (0, 0) is the centre of the top-left pixel.
"""

import numpy as np

from posefuse.visualize.colors import Colour


class Shapes:
    """Lines, discs, rings, crosses and squares in the order in which they are painted; grows as they are added."""

    def __init__(self) -> None:
        """No shape."""
        self._rows: list[tuple[float, ...]] = []

    def line(self, start: np.ndarray, end: np.ndarray, width_px: float, colour: Colour, opacity: float = 1.0) -> None:
        """A line with round ends from one (x, y) to another."""
        self._rows.append((*start, *end, 0.0, width_px / 2, *colour, opacity))

    def disc(self, centre: np.ndarray, radius_px: float, colour: Colour, opacity: float = 1.0) -> None:
        """A filled circle around (x, y)."""
        self._rows.append((*centre, *centre, 0.0, radius_px, *colour, opacity))

    def ring(self, centre: np.ndarray, radius_px: float, width_px: float, colour: Colour, opacity: float = 1.0) -> None:
        """A circle around (x, y)."""
        self._rows.append((*centre, *centre, radius_px, width_px / 2, *colour, opacity))

    def cross(self, centre: np.ndarray, radius_px: float, width_px: float, colour: Colour) -> None:
        """A slanting cross around (x, y)."""
        for step in (np.array([radius_px, radius_px]), np.array([radius_px, -radius_px])):
            self.line(centre - step, centre + step, width_px, colour)

    def square(self, centre: np.ndarray, radius_px: float, width_px: float, colour: Colour) -> None:
        """The outline of a square around (x, y)."""
        corners = centre + radius_px * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            self.line(start, end, width_px, colour)

    def paint(self, image: np.ndarray) -> None:
        """Paint them.

        Args:
            image: shape (height, width, 3), uint8, contiguous; painted on.
        """
        from posefuse.kernels.visualize import paint  # kernels start the compiler: only when called

        paint.paint(image, np.array(self._rows, dtype=np.float64).reshape(-1, paint.COLUMNS))


def shade(image: np.ndarray, left: int, top: int, width: int, height: int, colour: Colour, opacity: float) -> None:
    """Lay a colour over a rectangle, as far as it is within the picture."""
    part = image[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)]
    part[...] = np.round(part + (np.array(colour) - part) * opacity).astype(np.uint8)


def stamp(image: np.ndarray, mask: np.ndarray, left: int, top: int, colour: Colour) -> None:
    """Colour a picture through a mask.

    Args:
        image: shape (height, width, 3), uint8; painted on.
        mask: shape (rows, columns), uint8: 255 where the colour covers all; may lie outside in part.
        left: column of its first column in the picture.
        top: row of its first row.
        colour: red, green, blue.
    """
    rows, columns = mask.shape
    x0, y0 = max(left, 0), max(top, 0)
    x1, y1 = min(left + columns, image.shape[1]), min(top + rows, image.shape[0])
    if x1 <= x0 or y1 <= y0:
        return
    cover = mask[y0 - top : y1 - top, x0 - left : x1 - left, None] / 255.0
    part = image[y0:y1, x0:x1]
    part[...] = np.round(part + (np.array(colour) - part) * cover).astype(np.uint8)
