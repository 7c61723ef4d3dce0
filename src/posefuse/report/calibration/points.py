"""Points of known position in the report of a calibration: their fit, the worst ones first, and where they are."""

from html import escape

import numpy as np

from posefuse.calibration.assessment import WRONG_SDS
from posefuse.model.calibration_summary import CalibrationSummary, KnownPoints
from posefuse.report.calibration.figures import format_number, place_figure, rounded_up

_SHOWN_ROWS = 30


def points_section(summary: CalibrationSummary) -> str:
    """Return a table of the points, those that fit worst first; empty for other calibrations."""
    known = summary.known_points
    if known is None:
        return ""
    order = np.argsort(-np.nan_to_num(worst_sds(known), nan=-1.0), kind="stable")[:_SHOWN_ROWS]
    head = "".join(f"<th>{escape(name)}, px</th>" for name in summary.rig.names)
    body = "".join(_row(known, int(point)) for point in order)
    more = "" if len(order) == len(known.points_m) else f" The {len(order)} worst of {len(known.points_m)} are shown."
    return (
        "<section><h2>Points of known position</h2><p>Distance of each point in each image from where the other points "
        "of that image predict it, the worst points first. Distances that one of 1000 correct points exceeds are "
        f"marked.{more}</p>"
        '<div class="wide"><table class="numbers"><tr><th>Point</th><th>Position, m</th>'
        f"{head}</tr>{body}</table></div></section>"
    )


def worst_sds(known: KnownPoints) -> np.ndarray:
    """Return the largest distance of each point in standard deviations, shape (point,), NaN where unknown."""
    filled = np.where(np.isfinite(known.held_out_sds), known.held_out_sds, -1.0).max(axis=0)
    return np.where(filled < 0.0, np.nan, filled)


def _row(known: KnownPoints, point: int) -> str:
    cells = ""
    for error, held_out, sds in zip(
        known.error_px[:, point], known.held_out_px[:, point], known.held_out_sds[:, point], strict=True
    ):
        if not np.isfinite(error):
            cells += "<td>–</td>"
        elif not np.isfinite(held_out):
            cells += "<td>needed</td>"
        else:
            mark = ' class="wrong"' if sds > WRONG_SDS else ""
            cells += f"<td{mark}>{held_out:.1f}{' !' if mark else ''}</td>"
    place = ", ".join(f"{value:.3f}" for value in known.points_m[point])
    return f"<tr><th>{point + 1}</th><td>{place}</td>{cells}</tr>"


def point_cards(summary: CalibrationSummary) -> str:
    """Return one card per camera: the places of the points in its image, with their residuals as lines."""
    errors_px = np.concatenate([np.linalg.norm(each.residual_px, axis=1) for each in summary.cameras])
    line_px = rounded_up(3.0 * float(np.median(errors_px)))
    cards = ""
    for v, (camera, each) in enumerate(zip(summary.rig.cameras, summary.cameras, strict=True)):
        shown = np.flatnonzero(np.isfinite(summary.known_points.error_px[v])) if summary.known_points else []
        cards += (
            f'<article class="card" id="camera-{v}">'
            f'<h3><span class="chip person-{v % 10}"></span> {escape(camera.name)}</h3>'
            f'<p class="hint">{each.error_px:.2f} px root mean square of {len(each.pixels)} points.</p>'
            f'<div class="drawings">{place_figure(camera, each, [int(k) + 1 for k in shown], line_px)}</div></article>'
        )
    return (
        "<p>Each dot is a measured place. Its line leads towards the projection of the point; it is as long as a tenth "
        f"of the image's longer side for {format_number(line_px)} px. Points that surround the middle of the image "
        f'determine the pose best.</p><div class="cards">{cards}</div>'
    )
