"""Text on images, in the font bundled with Matplotlib, so that it looks the same on every machine."""

import io
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from posefuse.visualize.canvas import shade, stamp
from posefuse.visualize.colors import INK, Color
from posefuse.visualize.pillow_extra import require_pillow

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

_BACKGROUND_OPACITY = 0.6


def write_text(
    image: np.ndarray, text: str, left: float, bottom: float, height_px: int, color: Color
) -> tuple[int, int]:
    """Write a line of text on a shaded strip, shifted into the image if necessary.

    Args:
        image: shape (height, width, 3), uint8; modified in place.
        text: the line.
        left: column of the strip's left edge.
        bottom: row below the strip.
        height_px: height of the letters.
        color: red, green, blue.

    Returns:
        Width and height of the strip.

    Raises:
        ResultError: if Pillow or matplotlib is not installed.
    """
    mask = _mask(text, height_px)
    pad = max(2, height_px // 4)
    width, height = mask.shape[1] + 2 * pad, mask.shape[0] + 2 * pad
    x = round(float(np.clip(left, 0, max(image.shape[1] - width, 0))))
    y = round(float(np.clip(bottom - height, 0, max(image.shape[0] - height, 0))))
    shade(image, x, y, width, height, INK, _BACKGROUND_OPACITY)
    stamp(image, mask, x + pad, y + pad, color)
    return width, height


@lru_cache(maxsize=512)
def _mask(text: str, height_px: int) -> np.ndarray:
    """Return the coverage of each pixel by the letters, shape (row, column), uint8."""
    require_pillow()
    from PIL import Image, ImageDraw

    font = _font(height_px)
    ascent, descent = font.getmetrics()
    width = max(1, round(font.getlength(text)))
    image = Image.new("L", (width, ascent + descent))
    ImageDraw.Draw(image).text((0, 0), text, fill=255, font=font)
    return np.asarray(image)


@lru_cache(maxsize=16)
def _font(height_px: int) -> "FreeTypeFont":
    from PIL import ImageFont

    path = files("matplotlib").joinpath("mpl-data", "fonts", "ttf", "DejaVuSans.ttf")
    return ImageFont.truetype(io.BytesIO(path.read_bytes()), height_px, layout_engine=ImageFont.Layout.BASIC)
