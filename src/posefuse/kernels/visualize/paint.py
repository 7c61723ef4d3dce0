"""Smooth shapes on a picture: how far a pixel's centre is from a shape says how much of the pixel is covered."""

import math

from posefuse.kernels.jit import kernel

X0, Y0, X1, Y1, RADIUS, HALF_WIDTH, RED, GREEN, BLUE, OPACITY, COLUMNS = range(11)


@kernel
def paint(image, shapes):
    """Paint shapes one over the other.

    A shape is all that is within ``HALF_WIDTH`` of a line at the distance ``RADIUS`` around a segment: with radius 0 a
    line with round ends, or a disc where the segment is a point; with more, of a point, a ring.

    Args:
        image: shape (row, column, 3), uint8, written; pixel (0, 0) is the centre of the top-left pixel.
        shapes: shape (shape, COLUMNS): ends of the segment, radius and half the width in px, red, green and blue from 0
            to 255, opacity from 0 to 1. Those that hold what is not finite are left out.
    """
    rows, columns = image.shape[0], image.shape[1]
    for s in range(shapes.shape[0]):
        finite = True
        for c in range(COLUMNS):
            finite = finite and math.isfinite(shapes[s, c])
        if not finite:
            continue
        x0, y0, x1, y1 = shapes[s, X0], shapes[s, Y0], shapes[s, X1], shapes[s, Y1]
        radius, half, opacity = shapes[s, RADIUS], shapes[s, HALF_WIDTH], shapes[s, OPACITY]
        dx, dy = x1 - x0, y1 - y0
        length = math.sqrt(dx * dx + dy * dy)
        reach = radius + half + 0.5
        # Clipped before it becomes whole: a point near the camera's plane may lie further off than an integer reaches.
        top = math.ceil(min(max(min(y0, y1) - reach, 0.0), rows))
        bottom = math.floor(max(min(max(y0, y1) + reach, rows - 1.0), -1.0))
        for y in range(top, bottom + 1):
            left, right = min(x0, x1) - reach, max(x0, x1) + reach
            if math.fabs(dy) > 1e-6 * length:
                # Of a slanting line only what is near it in this row.
                middle, aside = x0 + (y - y0) / dy * dx, reach * length / math.fabs(dy)
                left, right = max(left, middle - aside), min(right, middle + aside)
            first = math.ceil(min(max(left, 0.0), columns))
            last = math.floor(max(min(right, columns - 1.0), -1.0))
            for x in range(first, last + 1):
                along = 0.0
                if length > 0.0:
                    along = min(max(((x - x0) * dx + (y - y0) * dy) / (length * length), 0.0), 1.0)
                off_x, off_y = x - x0 - along * dx, y - y0 - along * dy
                away = math.fabs(math.sqrt(off_x * off_x + off_y * off_y) - radius)
                cover = opacity * min(max(half + 0.5 - away, 0.0), 1.0)
                if cover > 0.0:
                    for c in range(3):
                        value = image[y, x, c] + (shapes[s, RED + c] - image[y, x, c]) * cover
                        image[y, x, c] = math.floor(value + 0.5)
