"""Anti-aliased drawing: the coverage of a pixel follows from the distance of its center to a shape."""

import math

from posefuse.kernels.jit import kernel

X0, Y0, X1, Y1, RADIUS, HALF_WIDTH, RED, GREEN, BLUE, OPACITY, COLUMNS = range(11)


@kernel
def paint(image, shapes):
    """Paint shapes onto an image, one over the other.

    A shape contains all points within ``HALF_WIDTH`` of a curve at distance ``RADIUS`` around a segment. With radius 0
    it is a line with round ends, or a disc if the segment is a point. With a positive radius around a point it is a
    ring.

    Args:
        image: shape (row, column, 3), uint8, written; pixel (0, 0) is the center of the top-left pixel.
        shapes: shape (shape, COLUMNS): end points of the segment, radius and half width in px, red, green and blue from
            0 to 255, opacity from 0 to 1. Shapes with non-finite values are skipped.
    """
    rows, columns = image.shape[0], image.shape[1]
    for s in range(shapes.shape[0]):
        finite = True
        for c in range(COLUMNS):
            finite = finite and math.isfinite(shapes[s, c])
        if not finite:
            continue
        x0, y0, x1, y1 = shapes[s, X0], shapes[s, Y0], shapes[s, X1], shapes[s, Y1]
        radius, half_width, opacity = shapes[s, RADIUS], shapes[s, HALF_WIDTH], shapes[s, OPACITY]
        dx, dy = x1 - x0, y1 - y0
        length = math.sqrt(dx * dx + dy * dy)
        extent = radius + half_width + 0.5
        # Clip before rounding: a point near the camera plane may project beyond the range of integers.
        top = math.ceil(min(max(min(y0, y1) - extent, 0.0), rows))
        bottom = math.floor(max(min(max(y0, y1) + extent, rows - 1.0), -1.0))
        for y in range(top, bottom + 1):
            left, right = min(x0, x1) - extent, max(x0, x1) + extent
            if math.fabs(dy) > 1e-6 * length:
                # Restrict a slanted line to the pixels near it in this row.
                row_x, half_span = x0 + (y - y0) / dy * dx, extent * length / math.fabs(dy)
                left, right = max(left, row_x - half_span), min(right, row_x + half_span)
            first = math.ceil(min(max(left, 0.0), columns))
            last = math.floor(max(min(right, columns - 1.0), -1.0))
            for x in range(first, last + 1):
                along = 0.0
                if length > 0.0:
                    along = min(max(((x - x0) * dx + (y - y0) * dy) / (length * length), 0.0), 1.0)
                off_x, off_y = x - x0 - along * dx, y - y0 - along * dy
                distance = math.fabs(math.sqrt(off_x * off_x + off_y * off_y) - radius)
                coverage = opacity * min(max(half_width + 0.5 - distance, 0.0), 1.0)
                if coverage > 0.0:
                    for c in range(3):
                        value = image[y, x, c] + (shapes[s, RED + c] - image[y, x, c]) * coverage
                        image[y, x, c] = math.floor(value + 0.5)
