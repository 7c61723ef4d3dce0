"""Painting, pixel by pixel over the whole image."""

import numpy as np


def paint(image: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Return a copy of the image with shapes (x0, y0, x1, y1, radius, half width, r, g, b, opacity) over it."""
    out = image.copy()
    y, x = np.mgrid[: image.shape[0], : image.shape[1]].astype(float)
    for x0, y0, x1, y1, radius, half, *color, opacity in shapes[np.isfinite(shapes).all(axis=1)]:
        d = np.array([x1 - x0, y1 - y0])
        length_2 = d @ d
        along = np.clip(((x - x0) * d[0] + (y - y0) * d[1]) / length_2, 0, 1) if length_2 > 0 else np.zeros_like(x)
        away = np.abs(np.hypot(x - x0 - along * d[0], y - y0 - along * d[1]) - radius)
        cover = opacity * np.clip(half + 0.5 - away, 0, 1)[..., None]
        out = np.floor(out + (np.array(color) - out) * cover + 0.5).astype(np.uint8)
    return out
