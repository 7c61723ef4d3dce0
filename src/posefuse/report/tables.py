"""The report's tables: truth, cameras, keypoints, bones, gaps, notes, options."""

import dataclasses
from html import escape
from typing import Any

import numpy as np

from posefuse.evaluation.accuracy import Accuracy
from posefuse.evaluation.people import PeopleScores
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.report.cells import MISSING, REJECTED, USED, Cells
from posefuse.report.highlights import jump, span
from posefuse.report.series import Gap, Series
from posefuse.report.summary import Summary


def accuracy_table(accuracy: Accuracy | PeopleScores | None) -> str:
    """How the result compares with the truth; empty where none was given."""
    if accuracy is None:
        return ""
    rows = _people_rows(accuracy) if isinstance(accuracy, PeopleScores) else _one_rows(accuracy)
    body = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<section><h2>Against the truth</h2><table>{body}</table></section>"


def _people_rows(scores: PeopleScores) -> list[tuple[str, str]]:
    clear, nees = scores.clear[0], scores.nees
    covered = f"{_percent(nees.covered_68)} / {_percent(nees.covered_95)}"
    return [
        ("People of the truth, of the result", f"{scores.n_true_people}, {scores.n_people}"),
        (f"MOTA, matched within {clear.gate_m:g} m", _percent(clear.mota)),
        ("IDF1", _percent(scores.identity.idf1)),
        ("Recall", _percent(clear.recall)),
        ("Identity switches, fragments, false people", f"{clear.switches}, {clear.fragments}, {clear.false_people}"),
        ("Median error", f"{_or_dash(scores.median_mm)} mm"),
        ("Mean error (MPJPE)", f"{_or_dash(scores.mpjpe_mm)} mm"),
        ("Inside their 68 / 95 % region", covered),
    ]


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if np.isfinite(share) else "–"


def _one_rows(accuracy: Accuracy) -> list[tuple[str, str]]:
    rows = [
        ("Compared points", f"{accuracy.n_points}"),
        ("Median error", f"{accuracy.median_mm:.1f} mm"),
        ("Mean error (MPJPE)", f"{accuracy.mpjpe_mm:.1f} mm"),
        ("90 / 95 / 99 %", f"{accuracy.p90_mm:.1f} / {accuracy.p95_mm:.1f} / {accuracy.p99_mm:.1f} mm"),
        ("Beyond 5 cm", f"{100 * accuracy.share_beyond_50_mm:.2f} %"),
        ("Missing", f"{100 * accuracy.missing_share:.2f} %"),
    ]
    if accuracy.covered_68 is not None and accuracy.covered_95 is not None:
        covered = f"{100 * accuracy.covered_68:.0f} / {100 * accuracy.covered_95:.0f} %"
        rows.append(("Inside their 68 / 95 % region", covered))
    return rows


def camera_table(result: Reconstruction, summary: Summary) -> str:
    """A line a camera."""
    head = "".join(f"<th>{escape(h)}</th>" for h in ("Camera", "Lens", "Used", "Median px", "90 % px"))
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
    """What readers and stages found worth saying, and what was read."""
    notes = result.provenance.notes
    inputs = [f"{name} (sha-256 {digest[:12]})" for name, digest in result.provenance.inputs.items()]
    items = [*notes, *(["Read: " + ", ".join(inputs)] if inputs else [])]
    return "<ul>" + "".join(f"<li>{escape(item)}</li>" for item in items) + "</ul>" if items else "<p>Nothing.</p>"


def options_table(options: Options) -> str:
    """What the user chose that is not the default, and all options folded."""
    values, usual = _flat(dataclasses.asdict(options)), _flat(dataclasses.asdict(Options()))
    chosen = {name: value for name, value in values.items() if usual.get(name) != value}
    first = f"<table>{_option_rows(chosen)}</table>" if chosen else "<p>All are the defaults.</p>"
    return f"{first}<details><summary>All options</summary><table>{_option_rows(values)}</table></details>"


def _flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Options by their full names, those that say nothing left out."""
    out: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            out |= _flat(value, f"{prefix}{name}.")
        elif value not in (None, ()):
            out[prefix + name] = value
    return out


def _option_rows(values: dict[str, Any]) -> str:
    return "".join(f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in values.items())


def keypoint_table(result: Reconstruction, summary: Summary, cells: Cells) -> str:
    """A line a keypoint with all its numbers, to read on paper."""
    heads = ("Keypoint", "Median px", "90 % px", "Points", "Detections used", "rejected", "missing")
    # Each camera shows as many frames as any other: the mean of its shares is the share of all. NaN where nobody was.
    shares = cells.shares.mean(axis=1)
    rows = []
    for k, name in enumerate(result.skeleton.keypoints):
        error = summary.error_px_by_keypoint[k]
        values = (1.0 - summary.missing_by_keypoint[k], *(shares[k, code] for code in (USED, REJECTED, MISSING)))
        rows.append(_row((name, _or_dash(error.median), _or_dash(error.p90), *(_percent(float(v)) for v in values))))
    return f'<table class="numbers">{_head(heads)}{"".join(rows)}</table>'


def bone_section(result: Reconstruction, series: Series) -> str:
    """Lengths of bones: of each its median, how it varies, and how the sides differ; the picture is drawn beside it."""
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
            spread = 1.4826 * float(np.median(np.abs(lengths - median)))
            share = f"{100 * spread / median:.1f} %" if median > 0 else "–"
            button = f'<button class="bone" data-bone="{b}">{escape(one)} – {escape(other)}</button>'
            rows.append(f"<tr><th>{button}</th>" + _cells((person, f"{median:.1f}", f"{spread:.1f}", share)) + "</tr>")
    head = _head(("Bone", "Person", f"Median {unit}", f"Spread {unit}", "Spread"))
    return (
        "<section><h2>Bone lengths</h2><p>As measured. A bone does not grow and shrink; where its length does, an end "
        "is wrong. Spread: robust standard deviation over time. Click a bone to draw it, click the drawing to see the "
        "frame.</p>"
        '<p id="bone-name" aria-live="polite"></p><div id="bones" class="chart" role="img" '
        'aria-label="Length of the chosen bone over time"></div>'
        f"{_folded('All bones', head + ''.join(rows))}</section>"
    )


def gap_section(result: Reconstruction, gaps: list[Gap]) -> str:
    """Where points were not measured; the picture is drawn beside it."""
    if not result.person_ids:
        return ""
    rows = []
    for gap in gaps:
        name, person = result.skeleton.keypoints[gap.keypoint], result.person_ids[gap.person]
        link = jump(result, gap.start, span(result, gap.start, gap.stop), person=gap.person, keypoint=gap.keypoint)
        length = gap.stop - gap.start
        filled = "filled" if gap.filled == length else "missing" if not gap.filled else f"{gap.filled} filled"
        rows.append(f"<tr><td>{link}</td>" + _cells((person, name, str(length), filled, gap.status.sentence)) + "</tr>")
    head = _head(("When", "Person", "Keypoint", "Frames", "", "How it begins"))
    table = (
        _folded(f"The longest {len(rows)}", head + "".join(rows))
        if rows
        else "<p>None: every point of everybody there was measured in every frame.</p>"
    )
    return (
        "<section><h2>Gaps and fills</h2><p>What most of each stretch of time is: "
        '<span class="key measured"></span> measured, <span class="key filled"></span> filled or held, '
        '<span class="key missing"></span> missing; blank where the person is absent.</p>'
        '<div id="gap-people"></div><div id="gaps" role="img" aria-label="Where each keypoint was measured, filled or '
        f'missing"></div>{table}</section>'
    )


def _folded(words: str, rows: str) -> str:
    return f'<details><summary>{words}</summary><div class="wide"><table>{rows}</table></div></details>'


def _head(names: tuple[str, ...]) -> str:
    return "<tr>" + "".join(f"<th>{escape(name)}</th>" for name in names) + "</tr>"


def _row(values: tuple[str, ...]) -> str:
    return f"<tr><th>{escape(values[0])}</th>{_cells(values[1:])}</tr>"


def _cells(values: tuple[str, ...]) -> str:
    return "".join(f"<td>{escape(value)}</td>" for value in values)
