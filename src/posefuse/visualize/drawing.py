"""Drawing of annotations on images."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.visualize.annotations import Annotations, ProjectedPerson
from posefuse.visualize.canvas import Shapes
from posefuse.visualize.colors import INK, PAPER, REJECTED, UNASSIGNED, Color, person_color
from posefuse.visualize.detection_labels import DetectionLabel, LabeledDetections
from posefuse.visualize.text import write_text

_FAINT_OPACITY = 0.4
_MANY_KEYPOINTS = 40
"""Skeletons with more keypoints, which include hands and a face, are drawn with smaller marks."""
_LEGEND = (
    (DetectionLabel.USED, "o used"),
    (DetectionLabel.SWAPPED, "□ left/right swapped"),
    (DetectionLabel.REJECTED, "× rejected"),
    (DetectionLabel.NOT_USED, "· not used"),
    (DetectionLabel.UNASSIGNED, "gray: unassigned"),
)


@dataclass(frozen=True)
class DrawingStyle:
    """Sizes of drawn elements.

    Attributes:
        line_px: width of bones.
        letter_px: height of letters.
        scale: width and height of the image divided by those of the calibration.
    """

    line_px: float
    letter_px: int
    scale: tuple[float, float] = (1.0, 1.0)

    @classmethod
    def of(cls, size_px: tuple[int, int], calibrated_px: tuple[int, int]) -> "DrawingStyle":
        """Return the style for an image size and the image size of the camera's calibration."""
        height = min(size_px)
        scale = (size_px[0] / calibrated_px[0], size_px[1] / calibrated_px[1])
        return cls(max(1.5, height / 300), max(11, round(height / 45)), scale)

    def to_image(self, pixels: np.ndarray) -> np.ndarray:
        """Convert pixels of the calibrated image to pixels of the drawn image."""
        return (pixels + 0.5) * np.array(self.scale) - 0.5


def draw(image: np.ndarray, annotations: Annotations | None, caption: Sequence[str], style: DrawingStyle) -> None:
    """Draw annotations and a caption.

    Args:
        image: shape (height, width, 3), uint8; modified in place.
        annotations: what to draw; None if the result has no frame at this time.
        caption: parts of the caption.
        style: sizes of the drawn elements.
    """
    if annotations is not None:
        shapes = Shapes()
        for person in annotations.people:
            _draw_person(shapes, person, annotations.edges, style)
        if annotations.detections is not None:
            _draw_detections(shapes, annotations.detections, style)
        shapes.paint(image)
        for person in annotations.people:
            _draw_name(image, person, style)
    parts = list(caption)
    if annotations is not None and annotations.detections is not None:
        labels = set(annotations.detections.label.tolist())
        parts += [text for label, text in _LEGEND if label in labels]
    height, width = image.shape[:2]
    top = height
    for text in reversed(_wrap(parts, style.letter_px, width)):
        top -= write_text(image, text, 0, top, style.letter_px, PAPER)[1]


def _draw_person(shapes: Shapes, person: ProjectedPerson, edges: np.ndarray, style: DrawingStyle) -> None:
    pixels, color = style.to_image(person.pixels), person_color(person.index)
    present = np.all(np.isfinite(pixels), axis=-1)
    bones = [(a, b) for a, b in edges.tolist() if present[a] and present[b]]
    opacity = [_FAINT_OPACITY if faint else 1.0 for faint in person.faint.tolist()]
    for a, b in bones:
        shapes.line(pixels[a], pixels[b], style.line_px + 2.0, INK, 0.5 * min(opacity[a], opacity[b]))
    for a, b in bones:
        shapes.line(pixels[a], pixels[b], style.line_px, color, min(opacity[a], opacity[b]))
    radius_px = (0.9 if len(pixels) <= _MANY_KEYPOINTS else 0.5) * style.line_px
    for k in np.flatnonzero(present).tolist():
        shapes.disc(pixels[k], radius_px + 1.0, INK, 0.5 * opacity[k])
        shapes.disc(pixels[k], radius_px, color, opacity[k])


def _draw_detections(shapes: Shapes, detections: LabeledDetections, style: DrawingStyle) -> None:
    many = detections.keypoint.max(initial=0) > _MANY_KEYPOINTS
    size_px, width_px = max(3.0, (1.0 if many else 1.8) * style.line_px), max(1.0, 0.4 * style.line_px)
    pixels, people = style.to_image(detections.pixels), detections.person.tolist()
    for pixel, label, person in zip(pixels, detections.label.tolist(), people, strict=True):
        color: Color = UNASSIGNED if person < 0 else person_color(person)
        if label == DetectionLabel.REJECTED:
            shapes.cross(pixel, size_px, width_px + 2.0, INK)
            shapes.cross(pixel, size_px, width_px + 0.5, REJECTED)
        elif label == DetectionLabel.SWAPPED:
            shapes.square(pixel, size_px, width_px + 1.5, INK)
            shapes.square(pixel, size_px, width_px, PAPER)
        elif label == DetectionLabel.NOT_USED:
            shapes.disc(pixel, width_px, color)
        else:
            shapes.ring(pixel, size_px, width_px + 1.5, INK, 0.5)
            shapes.ring(pixel, size_px, width_px, color)


def _draw_name(image: np.ndarray, person: ProjectedPerson, style: DrawingStyle) -> None:
    """Write the person's name above their highest point inside the image."""
    pixels = style.to_image(person.pixels)
    height, width = image.shape[:2]
    inside = np.isfinite(pixels).all(axis=-1) & (pixels >= 0).all(axis=-1) & (pixels < [width, height]).all(axis=-1)
    if not inside.any():
        return
    x, y = pixels[inside][np.argmin(pixels[inside][:, 1])]
    write_text(
        image, person.name, x - style.letter_px, y - 6 * style.line_px, style.letter_px, person_color(person.index)
    )


def _wrap(parts: Sequence[str], letter_px: int, width_px: int) -> list[str]:
    """Join parts of a caption to lines that fit the width."""
    lines: list[str] = []
    for part in parts:
        longer = f"{lines[-1]}   {part}" if lines else part
        if lines and 0.6 * letter_px * len(longer) < width_px:
            lines[-1] = longer
        else:
            lines.append(part)
    return lines
