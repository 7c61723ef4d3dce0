"""Words on a picture, in the font that Matplotlib brings, so that they look the same on every machine."""

import io
from functools import lru_cache
from importlib.resources import files

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from posefuse.visualize.canvas import shade, stamp
from posefuse.visualize.colors import INK, Colour

_SHADE = 0.6


def write_words(
    image: np.ndarray, words: str, left: float, bottom: float, height_px: int, colour: Colour
) -> tuple[int, int]:
    """Write a line on a shaded strip, moved so that it is within the picture if it fits.

    Args:
        image: shape (height, width, 3), uint8; drawn on.
        words: the line.
        left: column of the strip's left edge.
        bottom: row below the strip.
        height_px: of the letters.
        colour: red, green, blue.

    Returns:
        Width and height of the strip.
    """
    mask = _mask(words, height_px)
    pad = max(2, height_px // 4)
    width, height = mask.shape[1] + 2 * pad, mask.shape[0] + 2 * pad
    x = round(float(np.clip(left, 0, max(image.shape[1] - width, 0))))
    y = round(float(np.clip(bottom - height, 0, max(image.shape[0] - height, 0))))
    shade(image, x, y, width, height, INK, _SHADE)
    stamp(image, mask, x + pad, y + pad, colour)
    return width, height


@lru_cache(maxsize=512)
def _mask(words: str, height_px: int) -> np.ndarray:
    """Shape (row, column), uint8: how much each pixel is covered by the letters."""
    font = _font(height_px)
    ascent, descent = font.getmetrics()
    width = max(1, round(font.getlength(words)))
    picture = Image.new("L", (width, ascent + descent))
    ImageDraw.Draw(picture).text((0, 0), words, fill=255, font=font)
    return np.asarray(picture)


@lru_cache(maxsize=16)
def _font(height_px: int) -> ImageFont.FreeTypeFont:
    path = files("matplotlib").joinpath("mpl-data", "fonts", "ttf", "DejaVuSans.ttf")
    return ImageFont.truetype(io.BytesIO(path.read_bytes()), height_px, layout_engine=ImageFont.Layout.BASIC)
