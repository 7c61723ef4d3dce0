"""The report of a calibration: one self-contained HTML file, byte-identical for the same calibration."""

from collections.abc import Callable
from dataclasses import dataclass
from html import escape

import numpy as np

from posefuse.calibration.assessment import assess
from posefuse.calibration.residual_structure import COLUMNS, ROWS, residual_structure
from posefuse.model.calibration_summary import Advice, Assessment, CalibrationSummary, CalibrationTarget
from posefuse.report.calibration import tables
from posefuse.report.calibration.figures import (
    arrow_scale_px,
    format_number,
    image_figure,
    scatter_figure,
    scatter_scale_px,
)
from posefuse.report.calibration.points import point_cards, points_section
from posefuse.report.calibration.scene import calibration_scene, sd_range_m
from posefuse.report.messages import message_html
from posefuse.report.numbers import format_three_digits
from posefuse.report.page import asset, document, safe_json, script

_SCRIPTS = ("idle.js", "scene.js", "projection.js", "player.js", "start.js")
_VOLUMES: dict[CalibrationTarget, str] = {
    "board": "filmed volume", "people": "filmed volume", "points": "volume of the points",
}  # fmt: skip
_SHOWN: dict[CalibrationTarget, str] = {
    "board": "Thin lines are all poses of the board.",
    "people": "Thin lines are all places of the people.",
    "points": "Dots are the points of known position.",
}
_VERDICTS = {"good": ("✓", "Good"), "check": ("!", "Check"), "bad": ("✗", "Do not use")}


@dataclass(frozen=True)
class Section:
    """One section of the page.

    Attributes:
        name: placeholder in ``calibration.html``.
        render: returns the section as HTML.
    """

    name: str
    render: Callable[[CalibrationSummary, Assessment], str]


SECTIONS = (
    Section("subtitle", lambda summary, _: escape(_subtitle(summary))),
    Section("verdict", lambda _, assessment: _verdict(assessment)),
    Section("figures", lambda summary, _: _figures(summary)),
    Section("advice", lambda summary, assessment: _advice(summary, assessment)),
    Section("hint", lambda summary, _: _scene_hint(summary)),
    Section("cameras", lambda summary, _: tables.camera_table(summary)),
    Section("images", lambda summary, _: _images(summary)),
    Section("volume", lambda summary, _: tables.volume_table(summary)),
    Section("lengths", lambda summary, _: tables.length_table(summary)),
    Section("shared", lambda summary, _: tables.shared_section(summary)),
    Section("points", lambda summary, _: points_section(summary)),
    Section("scene_title", lambda summary, _: f"Cameras and {_VOLUMES[summary.target]}"),
    Section("volume_name", lambda summary, _: _VOLUMES[summary.target]),
    Section(
        "relative",
        lambda summary, _: (
            "in the world of the points" if summary.target == "points" else "relative to the reference camera"
        ),
    ),
    Section("notes", lambda summary, _: "".join(f"<li>{message_html(note)}</li>" for note in summary.rig.notes)),
)
"""The sections of the page; adding one takes a function, one record and a placeholder in ``calibration.html``."""


def render_calibration(summary: CalibrationSummary) -> str:
    """Return the report of a calibration as the text of an HTML file.

    Args:
        summary: what to show.
    """
    assessment = assess(summary)
    n = len(summary.rig)
    return document(
        "calibration.html",
        title=f"Calibration of {n} {'camera' if n == 1 else 'cameras'}",
        css=("report.css", "calibration.css"),
        scene=asset("scene.html"),
        theme=asset("theme.js"),
        script=script(_SCRIPTS, ("scene",)),
        data=safe_json({"scene": calibration_scene(summary)}),
        **{section.name: section.render(summary, assessment) for section in SECTIONS},
    )


def _subtitle(summary: CalibrationSummary) -> str:
    if summary.target == "points":
        return f"From {summary.source}: {summary.n_observations} places in {len(summary.cameras)} images"
    return f"From {summary.source}: {summary.n_observations} points in {len(summary.points_m)} frames"


def _verdict(assessment: Assessment) -> str:
    icon, label = _VERDICTS[assessment.level]
    return (
        f'<p class="verdict {assessment.level}"><span class="badge"><span aria-hidden="true">{icon}</span> {label}'
        f"</span><span>{message_html(assessment.sentence)}</span></p>"
    )


def _figures(summary: CalibrationSummary) -> str:
    """Return the key figures: a number, its unit and its name each."""
    held_out = [each.held_out_px for each in summary.cameras if np.isfinite(each.held_out_px)]
    shown = [(f"{summary.error_px:.2f}", "px", "root mean square error")]
    if held_out:
        what = "for held-out points" if summary.target == "points" else "in held-out images"
        shown.append((f"{float(np.sqrt(np.mean(np.square(held_out)))):.2f}", "px", what))
    shown += [(f"{100 * each.error:+.2f}", "%", each.name) for each in summary.lengths]
    volume = summary.volume
    shown.append(
        (
            format_three_digits(1000 * volume.relative_sd_m),
            "mm",
            "sd of places in the volume" if summary.target == "points" else "sd of points in the volume",
        )
    )
    length_sd = float(np.hypot(volume.length_sd, summary.scale_sd))
    shown.append((format_three_digits(100 * length_sd), "%", "sd of lengths"))
    return "".join(
        f'<div class="figure"><b>{value}</b> {unit}<br><span class="hint">{escape(name)}</span></div>'
        for value, unit, name in shown
    )


def _advice(summary: CalibrationSummary, assessment: Assessment) -> str:
    """Return the weaknesses and what to film next as a list; links lead to the camera."""
    if not assessment.advice:
        return "<p>Nothing: no weakness was found.</p>"
    return f'<ul class="advice">{"".join(_advice_item(summary, each) for each in assessment.advice)}</ul>'


def _advice_item(summary: CalibrationSummary, each: Advice) -> str:
    link = ""
    if each.camera in summary.rig.names:
        link = f' <a href="#camera-{summary.rig.index(each.camera)}">Show {escape(each.camera)}</a>'
    remedy = f" <b>{message_html(each.remedy)}</b>" if each.remedy else ""
    return f'<li class="{each.level}">{message_html(each.sentence)}{remedy}{link}</li>'


def _scene_hint(summary: CalibrationSummary) -> str:
    low, high = (format_three_digits(1000 * value) for value in sd_range_m(summary.volume))
    volume = _VOLUMES[summary.target]
    return (
        f"{_SHOWN[summary.target]} <b>Uncertainty</b> shows the {volume}, colored by the standard deviation of "
        f'triangulated points there: <span class="scale" aria-hidden="true"></span> {low} to {high} mm. '
        '<span id="truth-hint" hidden><span></span></span><span id="camera-hint" hidden></span>'
    )


def _images(summary: CalibrationSummary) -> str:
    """Return one card per camera, with the scales of all drawings."""
    if summary.target == "points":
        return point_cards(summary)
    arrow_px, half_px = arrow_scale_px(summary), scatter_scale_px(summary.cameras)
    cards = "".join(_card(summary, v, arrow_px, half_px) for v in range(len(summary.cameras)))
    return (
        "<p>Left: the darker a cell, the more points it has. A line is the mean residual of a cell; it is as long as "
        f"the side of a cell for {format_number(arrow_px)} px. Good images are covered to the corners, and their lines "
        "are short and point in all directions. Right: single residuals; the circle is their root mean square.</p>"
        f'<div class="cards">{cards}</div>'
    )


def _card(summary: CalibrationSummary, v: int, arrow_px: float, half_px: float) -> str:
    camera, each = summary.rig.cameras[v], summary.cameras[v]
    covered = 100 * np.mean(each.counts(camera.size_px, COLUMNS, ROWS) > 0)
    drawings = image_figure(camera, each, arrow_px) + scatter_figure(camera, each, half_px)
    systematic = residual_structure(each, camera.size_px).systematic_px
    structure = (
        "too few images to judge the lens"
        if np.isnan(systematic)
        else f"{systematic:.2f} px depend on the place in the image"
    )
    return (
        f'<article class="card" id="camera-{v}">'
        f'<h3><span class="chip person-{v % 10}"></span> {escape(camera.name)}</h3>'
        f'<p class="hint">{each.error_px:.2f} px, of which {structure}; points in {covered:.0f} % of the image.</p>'
        f'<div class="drawings">{drawings}</div></article>'
    )
