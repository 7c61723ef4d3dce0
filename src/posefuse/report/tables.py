"""Tables of the report: accuracy, cameras, keypoints, bones, gaps, notes and options."""

import dataclasses
from html import escape
from typing import Any

import numpy as np

from posefuse.evaluation.accuracy import Accuracy
from posefuse.evaluation.people import PeopleScores
from posefuse.model.layer_scores import layer_of_scores
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.report.heat_map import MISSING, REJECTED, USED, HeatMap
from posefuse.report.highlights import format_interval, frame_button
from posefuse.report.messages import message_html
from posefuse.report.series import Gap, TimeSeries
from posefuse.report.summary import Summary
from posefuse.skeleton.subject_words import subject_heading


def accuracy_table(accuracy: Accuracy | PeopleScores | None) -> str:
    """Return the comparison with the ground truth as HTML; empty if there is no ground truth."""
    if accuracy is None:
        return ""
    rows = _people_rows(accuracy) if isinstance(accuracy, PeopleScores) else _single_person_rows(accuracy)
    body = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    heading = '<h2 data-short="Ground truth">Comparison with the ground truth</h2>'
    return f"<section>{heading}<table>{body}</table></section>"


def _people_rows(scores: PeopleScores) -> list[tuple[str, str]]:
    clear, nees = scores.clear[0], scores.nees
    covered = f"{_percent(nees.covered_68)} / {_percent(nees.covered_95)}"
    return [
        ("People in the ground truth, in the result", f"{scores.n_true_people}, {scores.n_people}"),
        (f"MOTA, matching distance {clear.gate_m:g} m", _percent(clear.mota)),
        ("IDF1", _percent(scores.identity.idf1)),
        ("Recall", _percent(clear.recall)),
        (
            "Identity switches, fragmentations, false people",
            f"{clear.switches}, {clear.fragments}, {clear.false_people}",
        ),
        ("Median error", f"{_or_dash(scores.median_mm)} mm"),
        ("Mean error (MPJPE)", f"{_or_dash(scores.mpjpe_mm)} mm"),
        ("Coverage of the 68 / 95 % regions", covered),
    ]


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if np.isfinite(share) else "–"


def _single_person_rows(accuracy: Accuracy) -> list[tuple[str, str]]:
    rows = [
        ("Compared points", f"{accuracy.n_points}"),
        ("Median error", f"{accuracy.median_mm:.1f} mm"),
        ("Mean error (MPJPE)", f"{accuracy.mpjpe_mm:.1f} mm"),
        ("90th / 95th / 99th percentile", f"{accuracy.p90_mm:.1f} / {accuracy.p95_mm:.1f} / {accuracy.p99_mm:.1f} mm"),
        ("Beyond 5 cm", f"{100 * accuracy.share_beyond_50_mm:.2f} %"),
        ("Missing points", f"{100 * accuracy.missing_share:.2f} %"),
    ]
    if accuracy.covered_68 is not None and accuracy.covered_95 is not None:
        covered = f"{100 * accuracy.covered_68:.0f} / {100 * accuracy.covered_95:.0f} %"
        rows.append(("Coverage of the 68 / 95 % regions", covered))
    return rows


def layer_section(result: Reconstruction) -> str:
    """Return how well each layer predicts left-out views as HTML; empty if layers were not compared."""
    best = layer_of_scores(result.layer_scores)
    if best is None:
        return ""
    headings = ("Layer", "Median, px", "Mean, px", "Points, of those measured")
    head = "".join(f"<th>{escape(heading)}</th>" for heading in headings)
    rows = []
    for score in result.layer_scores:
        name = f"{score.layer} (default)" if score.layer == best else score.layer
        cells = (name, _or_dash(score.median_px), _or_dash(score.mean_px), _percent(score.share))
        rows.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    return (
        "<section><h2>Layers</h2><p>Distance between the detections of one camera and the points of the other cameras, "
        "over the points that all layers have. The layer with the smallest errors is the default, unless it lacks more "
        "than 1 % of the measured points. Errors within 1 % of the smallest are equal; the ratios of the errors then "
        "decide, and the solved layer is preferred where these are equal, too. With three cameras, "
        "the most processed layer within 5 % of the smallest is the default.</p>"
        f'<div class="wide"><table><tr>{head}</tr>{"".join(rows)}</table></div></section>'
    )


def camera_table(result: Reconstruction, summary: Summary) -> str:
    """Return the table of cameras as HTML."""
    headings = ("Camera", "Lens", "Used", "Median error, px", "90th percentile, px")
    head = "".join(f"<th>{escape(heading)}</th>" for heading in headings)
    rows = []
    for v, camera in enumerate(result.rig.cameras):
        error = summary.error_px_by_view[v]
        used = f"{100 * summary.used[v]:.1f} %"
        cells = (camera.name, str(camera.lens), used, _or_dash(error.median), _or_dash(error.p90))
        rows.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    return f'<div class="wide"><table><tr>{head}</tr>{"".join(rows)}</table></div>'


def _or_dash(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "–"


def notes_list(result: Reconstruction) -> str:
    """Return the notes of readers and stages and the list of input files as HTML."""
    notes = result.provenance.notes
    inputs = [f"{name} (sha-256 {digest[:12]})" for name, digest in result.provenance.inputs.items()]
    items = [*notes, *(["Input files: " + ", ".join(inputs)] if inputs else [])]
    return "<ul>" + "".join(f"<li>{message_html(item)}</li>" for item in items) + "</ul>" if items else "<p>None.</p>"


def options_table(options: Options) -> str:
    """Return the options that differ from the defaults, and all options in a collapsed table, as HTML."""
    values, defaults = _flatten(dataclasses.asdict(options)), _flatten(dataclasses.asdict(Options()))
    changed = {name: value for name, value in values.items() if defaults.get(name) != value}
    first = f"<table>{_option_rows(changed)}</table>" if changed else "<p>All options have their defaults.</p>"
    return f"{first}<details><summary>All options</summary><table>{_option_rows(values)}</table></details>"


def _flatten(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return options by their full names, without unset ones."""
    out: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            out |= _flatten(value, f"{prefix}{name}.")
        elif value not in (None, ()):
            out[prefix + name] = value
    return out


def _option_rows(values: dict[str, Any]) -> str:
    return "".join(f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in values.items())


def keypoint_table(result: Reconstruction, summary: Summary, cells: HeatMap) -> str:
    """Return the table of keypoints as HTML, which replaces the chart on paper."""
    headings = (
        "Keypoint", "Median error, px", "90th percentile, px", "Points", "Detections used", "Detections rejected",
        "Detections missing",
    )  # fmt: skip
    # All cameras have the same number of frames, so the mean of their shares is the share over all detections.
    shares = cells.shares.mean(axis=1)
    rows = []
    for k, name in enumerate(result.skeleton.keypoints):
        error = summary.error_px_by_keypoint[k]
        values = (1.0 - summary.missing_by_keypoint[k], *(shares[k, code] for code in (USED, REJECTED, MISSING)))
        rows.append(_row((name, _or_dash(error.median), _or_dash(error.p90), *(_percent(float(v)) for v in values))))
    return f'<table class="numbers">{_head(headings)}{"".join(rows)}</table>'


def bone_section(result: Reconstruction, series: TimeSeries) -> str:
    """Return the section on bone lengths as HTML: median and variation of each bone, and a chart of the chosen one."""
    if not series.bones or not result.person_ids:
        return ""
    unit, scale = ("mm", 1000.0) if result.unit == "m" else (result.unit, 1.0)
    rows = []
    for b, (one, other) in enumerate(series.bones):
        for p, person in enumerate(result.person_ids):
            lengths = scale * series.bones_m[:, p, b]
            lengths = lengths[np.isfinite(lengths)]
            if not len(lengths):
                continue
            median = float(np.median(lengths))
            deviation = 1.4826 * float(np.median(np.abs(lengths - median)))
            share = f"{100 * deviation / median:.1f} %" if median > 0 else "–"
            button = f'<button class="bone" data-bone="{b}">{escape(one)} – {escape(other)}</button>'
            rows.append(
                f"<tr><th>{button}</th>" + _cells((person, f"{median:.1f}", f"{deviation:.1f}", share)) + "</tr>"
            )
    head = _head(("Bone", subject_heading(result.skeleton), f"Median, {unit}", f"SD, {unit}", "SD, relative"))
    return (
        "<section><h2>Bone lengths</h2><p>Measured lengths. Bones are rigid, so a varying length reveals an error at "
        "one end. SD is the robust standard deviation over time. Click a bone to plot it; click the plot to see "
        "the frame.</p>"
        '<p id="bone-name" aria-live="polite"></p><div id="bones" class="chart" role="img" '
        'aria-label="Length of the selected bone over time"></div>'
        f"{_collapsed('All bones', head + ''.join(rows))}</section>"
    )


def gap_section(result: Reconstruction, gaps: list[Gap]) -> str:
    """Return the section on gaps as HTML, with a table of the longest ones; empty for unrelated frames."""
    if not result.person_ids or not result.has_identities:
        return ""
    rows = []
    for gap in gaps:
        name, person = result.skeleton.keypoints[gap.keypoint], result.person_ids[gap.person]
        link = frame_button(
            result, gap.start, format_interval(result, gap.start, gap.stop), person=gap.person, keypoint=gap.keypoint
        )
        length = gap.stop - gap.start
        handling = "filled" if gap.filled == length else "missing" if not gap.filled else f"{gap.filled} filled"
        rows.append(
            f"<tr><td>{link}</td>" + _cells((person, name, str(length), handling, gap.status.sentence)) + "</tr>"
        )
    subject = subject_heading(result.skeleton)
    head = _head(("Interval", subject, "Keypoint", "Frames", "Handling", "Status of the first frame"))
    table = (
        _collapsed(f"Longest gaps ({len(rows)})", head + "".join(rows))
        if rows
        else "<p>No gaps: every keypoint was measured in every frame in which its subject is present.</p>"
    )
    return (
        "<section><h2>Gaps</h2><p>The most frequent state of each time interval: "
        '<span class="key measured"></span> measured, <span class="key filled"></span> filled or held, '
        '<span class="key missing"></span> missing; blank where the subject is absent.</p>'
        '<div id="gap-people"></div><div id="gaps" role="img" aria-label="When each keypoint was measured, filled or '
        f'missing"></div>{table}</section>'
    )


def _collapsed(title: str, rows: str) -> str:
    return f'<details><summary>{title}</summary><div class="wide"><table>{rows}</table></div></details>'


def _head(names: tuple[str, ...]) -> str:
    return "<tr>" + "".join(f"<th>{escape(name)}</th>" for name in names) + "</tr>"


def _row(values: tuple[str, ...]) -> str:
    return f"<tr><th>{escape(values[0])}</th>{_cells(values[1:])}</tr>"


def _cells(values: tuple[str, ...]) -> str:
    return "".join(f"<td>{escape(value)}</td>" for value in values)
