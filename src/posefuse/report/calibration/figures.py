"""Drawings of a calibration as SVG: coverage and residuals of each image."""

from collections.abc import Sequence
from html import escape

import numpy as np

from posefuse.calibration.residual_structure import COLUMNS, ROWS, residual_structure
from posefuse.model.calibration_summary import CalibrationSummary, CameraSummary
from posefuse.model.cameras import Camera
from posefuse.report.numbers import format_three_digits

_WIDTH = 480.0
_SCATTER = 150.0
_SHOWN_POINTS = 300
_ROUND_PX = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)


def arrow_scale_px(summary: CalibrationSummary) -> float:
    """Return the residual that an arrow as long as the side of a cell stands for, the same for all cameras."""
    longest = [
        np.nanmax(np.append(np.hypot(*np.moveaxis(residual_structure(each, camera.size_px).mean_px, -1, 0)), 0.0))
        for camera, each in zip(summary.rig.cameras, summary.cameras, strict=True)
    ]
    return rounded_up(float(max(longest)))


def scatter_scale_px(cameras: Sequence[CameraSummary]) -> float:
    """Return half the side of the scatter of residuals, the same for all cameras."""
    return rounded_up(3.0 * float(np.nanmedian([each.error_px for each in cameras])))


def rounded_up(value: float) -> float:
    """Return the next round number."""
    return next((each for each in _ROUND_PX if each >= value), value)


def image_figure(camera: Camera, each: CameraSummary, arrow_px: float) -> str:
    """Return the image of a camera with the number of points in each cell, and mean residuals as arrows, as SVG."""
    width, height = camera.size_px
    tall = _WIDTH * height / width
    counts = each.counts(camera.size_px, COLUMNS, ROWS)
    mean = residual_structure(each, camera.size_px).mean_px
    cell = np.array([_WIDTH / COLUMNS, tall / ROWS])
    parts = []
    for r in range(ROWS):
        for c in range(COLUMNS):
            x, y = cell * (c, r)
            if counts[r, c]:
                share = np.log1p(counts[r, c]) / np.log1p(counts.max())
                parts.append(
                    f'<rect x="{x:.1f}" y="{y:.1f}" width="{cell[0]:.1f}" height="{cell[1]:.1f}" '
                    f'fill-opacity="{0.08 + 0.3 * share:.2f}"><title>{counts[r, c]} points</title></rect>'
                )
    for r in range(ROWS):
        for c in range(COLUMNS):
            if np.isfinite(mean[r, c, 0]):
                start = cell * (c + 0.5, r + 0.5)
                parts.append(_arrow(start, start + mean[r, c] / arrow_px * cell.min()))
    text = escape(f"Points and mean residuals over the image of camera {camera.name}")
    return (
        f'<svg class="image" viewBox="0 0 {_WIDTH:.0f} {tall:.0f}" role="img" aria-label="{text}">'
        f'<rect class="frame" width="{_WIDTH:.0f}" height="{tall:.0f}"/>{"".join(parts)}</svg>'
    )


def place_figure(camera: Camera, each: CameraSummary, numbers: Sequence[int], line_px: float) -> str:
    """Return the image of a camera with numbered places of points and their residuals as lines, as SVG.

    Args:
        camera: the camera.
        each: its places and residuals.
        numbers: numbers of the points.
        line_px: residual that a line as long as a tenth of the image's longer side stands for.
    """
    width, height = camera.size_px
    scale = _WIDTH / max(width, height)
    wide, tall = scale * width, scale * height
    parts = []
    for number, place, residual in zip(numbers, each.pixels, each.residual_px, strict=True):
        start = (place + 0.5) * scale
        error = float(np.hypot(*residual))
        parts.append(
            f"<g><title>point {number}: {error:.1f} px</title>{_arrow(start, start + residual / line_px * _WIDTH / 10)}"
            f'<text x="{start[0] + 5:.1f}" y="{start[1] - 5:.1f}">{number}</text></g>'
        )
    text = escape(f"Places and residuals of points in the image of camera {camera.name}")
    return (
        f'<svg class="image places" viewBox="0 0 {wide:.0f} {tall:.0f}" role="img" aria-label="{text}">'
        f'<rect class="frame" width="{wide:.0f}" height="{tall:.0f}"/>{"".join(parts)}</svg>'
    )


def _arrow(start: np.ndarray, end: np.ndarray) -> str:
    """Return an arrow with a dot at its start."""
    return (
        f'<circle cx="{start[0]:.1f}" cy="{start[1]:.1f}" r="1.6"/>'
        f'<line x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}"/>'
    )


def scatter_figure(camera: Camera, each: CameraSummary, half_px: float) -> str:
    """Return the residuals of a camera as points, with a circle at their root mean square, as SVG."""
    chosen = np.unique(np.linspace(0, len(each.residual_px) - 1, _SHOWN_POINTS).astype(np.int64))
    half = _SCATTER / 2
    places = half + np.clip(each.residual_px[chosen] / half_px, -0.98, 0.98) * half
    dots = "".join(f'<circle class="dot" cx="{x:.1f}" cy="{y:.1f}" r="1.5"/>' for x, y in places)
    radius = min(each.error_px / half_px, 1.4) * half
    text = escape(f"Residuals of camera {camera.name}: root mean square {each.error_px:.2f} px")
    return (
        f'<svg class="scatter" viewBox="0 0 {_SCATTER:.0f} {_SCATTER:.0f}" role="img" aria-label="{text}">'
        f'<rect class="frame" width="{_SCATTER:.0f}" height="{_SCATTER:.0f}"/>'
        f'<path class="axis" d="M{half} 0V{_SCATTER}M0 {half}H{_SCATTER}"/>{dots}'
        f'<circle class="ring" cx="{half}" cy="{half}" r="{radius:.1f}"/>'
        f'<text x="{_SCATTER - 4}" y="{half - 4}" text-anchor="end">{format_number(half_px)} px</text></svg>'
    )


def format_number(value: float) -> str:
    """Return a round number without trailing zeros."""
    return f"{value:g}" if value in _ROUND_PX else format_three_digits(value)
