"""Sketches on pictures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.visualize.canvas import Shapes
from posefuse.visualize.colors import INK, NOBODY, PAPER, REJECTED, Colour, colour_of
from posefuse.visualize.detection_labels import Fate, Sightings
from posefuse.visualize.skeleton_drawing import Figure, Sketch
from posefuse.visualize.text import write_words

_FAINT = 0.4
_MANY_KEYPOINTS = 40
"""Skeletons with more, which have hands and a face, are drawn with smaller marks."""
_LEGEND = (
    (Fate.USED, "o used"),
    (Fate.SWAPPED, "□ left for right"),
    (Fate.REJECTED, "× rejected"),
    (Fate.NOT_USED, "· not used"),
    (Fate.NOBODY, "grey: nobody's"),
)


@dataclass(frozen=True)
class Pen:
    """How large things are drawn.

    Attributes:
        line_px: width of bones.
        letter_px: height of letters.
        scale: width and height of the picture over those of the calibration.
    """

    line_px: float
    letter_px: int
    scale: tuple[float, float] = (1.0, 1.0)

    @classmethod
    def of(cls, size_px: tuple[int, int], calibrated_px: tuple[int, int]) -> "Pen":
        """A pen that suits a picture of a size, of a camera calibrated at another."""
        height = min(size_px)
        scale = (size_px[0] / calibrated_px[0], size_px[1] / calibrated_px[1])
        return cls(max(1.5, height / 300), max(11, round(height / 45)), scale)

    def place(self, pixels: np.ndarray) -> np.ndarray:
        """Where pixels of the calibrated image are in the picture; both count from the centre of the first pixel."""
        return (pixels + 0.5) * np.array(self.scale) - 0.5


def draw(image: np.ndarray, sketch: Sketch | None, heading: Sequence[str], pen: Pen) -> None:
    """Draw a sketch and a line of words.

    Args:
        image: shape (height, width, 3), uint8; drawn on.
        sketch: what is drawn; None where the result has no frame at this time.
        heading: words of the line, put together.
        pen: of its size.
    """
    if sketch is not None:
        shapes = Shapes()
        for figure in sketch.figures:
            _figure(shapes, figure, sketch.edges, pen)
        if sketch.sightings is not None:
            _sightings(shapes, sketch.sightings, pen)
        shapes.paint(image)
        for figure in sketch.figures:
            _name(image, figure, pen)
    words = list(heading)
    if sketch is not None and sketch.sightings is not None:
        there = set(sketch.sightings.fate.tolist())
        words += [text for fate, text in _LEGEND if fate in there]
    height, width = image.shape[:2]
    top = height
    for text in reversed(_lines(words, pen.letter_px, width)):
        top -= write_words(image, text, 0, top, pen.letter_px, PAPER)[1]


def _figure(shapes: Shapes, figure: Figure, edges: np.ndarray, pen: Pen) -> None:
    pixels, colour = pen.place(figure.pixels), colour_of(figure.person)
    there = np.all(np.isfinite(pixels), axis=-1)
    bones = [(a, b) for a, b in edges.tolist() if there[a] and there[b]]
    opacity = [_FAINT if faint else 1.0 for faint in figure.faint.tolist()]
    for a, b in bones:
        shapes.line(pixels[a], pixels[b], pen.line_px + 2.0, INK, 0.5 * min(opacity[a], opacity[b]))
    for a, b in bones:
        shapes.line(pixels[a], pixels[b], pen.line_px, colour, min(opacity[a], opacity[b]))
    radius_px = (0.9 if len(pixels) <= _MANY_KEYPOINTS else 0.5) * pen.line_px
    for k in np.flatnonzero(there).tolist():
        shapes.disc(pixels[k], radius_px + 1.0, INK, 0.5 * opacity[k])
        shapes.disc(pixels[k], radius_px, colour, opacity[k])


def _sightings(shapes: Shapes, seen: Sightings, pen: Pen) -> None:
    many = seen.keypoint.max(initial=0) > _MANY_KEYPOINTS
    size_px, width_px = max(3.0, (1.0 if many else 1.8) * pen.line_px), max(1.0, 0.4 * pen.line_px)
    for pixel, fate, person in zip(pen.place(seen.pixels), seen.fate.tolist(), seen.person.tolist(), strict=True):
        colour: Colour = NOBODY if person < 0 else colour_of(person)
        if fate == Fate.REJECTED:
            shapes.cross(pixel, size_px, width_px + 2.0, INK)
            shapes.cross(pixel, size_px, width_px + 0.5, REJECTED)
        elif fate == Fate.SWAPPED:
            shapes.square(pixel, size_px, width_px + 1.5, INK)
            shapes.square(pixel, size_px, width_px, PAPER)
        elif fate == Fate.NOT_USED:
            shapes.disc(pixel, width_px, colour)
        else:
            shapes.ring(pixel, size_px, width_px + 1.5, INK, 0.5)
            shapes.ring(pixel, size_px, width_px, colour)


def _name(image: np.ndarray, figure: Figure, pen: Pen) -> None:
    """The person's name above their highest point within the picture."""
    pixels = pen.place(figure.pixels)
    height, width = image.shape[:2]
    inside = np.isfinite(pixels).all(axis=-1) & (pixels >= 0).all(axis=-1) & (pixels < [width, height]).all(axis=-1)
    if not inside.any():
        return
    x, y = pixels[inside][np.argmin(pixels[inside][:, 1])]
    write_words(image, figure.name, x - pen.letter_px, y - 6 * pen.line_px, pen.letter_px, colour_of(figure.person))


def _lines(words: Sequence[str], letter_px: int, width_px: int) -> list[str]:
    """Words put together in lines that fit."""
    lines: list[str] = []
    for word in words:
        longer = f"{lines[-1]}   {word}" if lines else word
        if lines and 0.6 * letter_px * len(longer) < width_px:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines
